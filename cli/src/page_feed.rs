//! Feeds the page as a consumer of the bus that receives only the newest state: it is independent of the daemon, waits
//! while none runs, and continues with the next one.

mod frame_configuration;
mod history;
mod station;

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use equipoise_bus::{Bus, BusError, BusSettings, Publisher, Subscriber};
use equipoise_config::model::suggestion;
use equipoise_config::{Config, PageConfig};
use equipoise_core::message::{ConsumerReceipt, State};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_core::time::NS_PER_S;
use equipoise_daemon::realtime::now_ns;
use equipoise_station::bus_directory::BusDirectory;
use equipoise_station::status::PageFile;
use equipoise_view::is_current;
use equipoise_view::page::{Engineer, LiftResult, Page, PageFrame, SimulatedCobot, SimulatedHuman};
use equipoise_view::suggested_pose::SuggestedPose;
use tracing::warn;

use self::frame_configuration::FrameConfiguration;
use crate::page_tokens::PageTokens;
use crate::receipt::ReceiptBuilder;

/// Role of the page on the bus.
pub const PAGE_ROLE: &str = "page";
/// Consumer name in latency reports, which cover the path up to the page's server, before transmission.
pub const CONSUMER_NAME: &str = "view";
/// Polling interval for the newest state.
const POLL_INTERVAL: Duration = Duration::from_millis(8);
/// Interval for checking that the joined bus still exists, and for retries of joining.
const BUS_CHECK_INTERVAL: Duration = Duration::from_secs(1);
/// States older than this are not displayed, ns.
const FRESH_NS: u64 = NS_PER_S / 4;
/// Interval of latency reports.
const REPORT_INTERVAL: Duration = Duration::from_secs(1);

type Newest = Mutex<Option<State>>;
type SharedFrameConfiguration = Mutex<FrameConfiguration>;
type Simulated = Mutex<(Option<SimulatedHuman>, Option<SimulatedCobot>)>;
type Receipts = Mutex<ReceiptBuilder>;

/// A page being served, and the thread that feeds it. Dropping it closes connections and leaves the bus.
pub struct ServedPage {
    page: Page,
    /// The feed continues while this reference exists.
    newest: Option<Arc<Newest>>,
    threads: Vec<JoinHandle<()>>,
    requests: Arc<AtomicU64>,
    simulated: Arc<Simulated>,
    file: PageFile,
}

impl ServedPage {
    /// Serves the page of a configuration; `base` is the folder to which a relative `token_file` refers.
    ///
    /// # Errors
    /// The port is taken, the token cannot be used, or the bus cannot be joined.
    pub fn start(config: &Config, page: &PageConfig, base: &Path) -> anyhow::Result<ServedPage> {
        let PageTokens { page: token, command: command_token } = PageTokens::read(page, base)?;
        let report = page.report.as_ref().map(|file| base.join(file));
        let station_data = Arc::new(station::StationData::new(&config.station, report));
        let engineer = Engineer { station: Arc::clone(&station_data) as _, command_token };
        let newest = Arc::new(Newest::default());
        let requests = Arc::new(AtomicU64::new(0));
        let receipts = Arc::new(Receipts::new(ReceiptBuilder::new(CONSUMER_NAME, now_ns())));
        let simulated = Arc::new(Simulated::default());
        let frame_configuration = Arc::new(SharedFrameConfiguration::new(FrameConfiguration::of(config)));
        let feed = FrameFeed {
            newest: Arc::downgrade(&newest),
            frame_configuration: Arc::clone(&frame_configuration),
            receipts: Arc::clone(&receipts),
            requests: Arc::clone(&requests),
            simulated: Arc::clone(&simulated),
        };
        let frames = move || feed.frame(now_ns());
        let page = Page::start_with(page.listen, token, frames, Some(engineer)).context("page.listen")?;
        let feed = start_feed(&config.station, Arc::downgrade(&newest), receipts)?;
        let collecting =
            station::start_collecting(station_data, Arc::downgrade(&newest), frame_configuration)?;
        let file = PageFile::new(&config.station, page.url(), token.is_some());
        // Without the file only `equipoise status` is affected: it does not list the page.
        if let Err(error) = file.write() {
            warn!("cannot write {}: {error}", file.path.display());
        }
        Ok(ServedPage {
            page,
            newest: Some(newest),
            threads: vec![feed, collecting],
            requests,
            simulated,
            file,
        })
    }

    /// The page's URL for a browser.
    pub fn url(&self) -> String {
        self.page.url()
    }

    /// Whether server and feed are running.
    pub fn is_running(&self) -> bool {
        self.page.is_running() && self.threads.iter().all(|thread| !thread.is_finished())
    }

    /// Whether a viewer has opened the page.
    pub fn has_been_viewed(&self) -> bool {
        self.page.streams_opened() > 0
    }

    /// Sets the simulated human and cobot of the frames from now on.
    pub fn set_simulated(&self, human: SimulatedHuman, cobot: Option<SimulatedCobot>) {
        *self.simulated.lock().unwrap_or_else(PoisonError::into_inner) = (Some(human), cobot);
    }

    /// Ends the page of a demonstration: open pages keep displaying these results.
    pub fn end(mut self, results: &[LiftResult]) {
        self.page.end(results);
    }

    /// Number of frames requested by the page's thread: increments sixty times a second while the thread runs.
    pub fn requests(&self) -> u64 {
        self.requests.load(Ordering::Relaxed)
    }
}

impl Drop for ServedPage {
    fn drop(&mut self) {
        self.newest = None;
        for thread in self.threads.drain(..) {
            // The thread itself has printed its panic.
            let _ = thread.join();
        }
        self.file.remove();
    }
}

/// Starts the thread that receives the newest state of a station; it ends when `newest` is dropped.
fn start_feed(
    station: &str,
    newest: Weak<Newest>,
    receipts: Arc<Receipts>,
) -> anyhow::Result<JoinHandle<()>> {
    let settings = BusSettings::new(station, PAGE_ROLE);
    let (result_sender, first_result) = crossbeam_channel::bounded(1);
    // Ports of the bus are bound to one thread, so this thread opens them.
    let thread = std::thread::Builder::new().name("page-feed".into()).spawn(move || {
        // A failure of the first join is returned to the caller; later failures are retried.
        match join(&settings) {
            Ok(ports) => {
                let _ = result_sender.send(Ok(()));
                receive_until_replaced(ports, &settings.root, &newest, &receipts);
            }
            Err(error) => {
                let _ = result_sender.send(Err(error));
                return;
            }
        }
        while newest.strong_count() > 0 {
            match join(&settings) {
                Ok(ports) => receive_until_replaced(ports, &settings.root, &newest, &receipts),
                Err(error) => {
                    warn!("the page has no data: {error}");
                    std::thread::sleep(BUS_CHECK_INTERVAL);
                }
            }
        }
    })?;
    first_result.recv().map_err(|_| anyhow!("the page's feed ended before it began"))??;
    Ok(thread)
}

/// Ports are declared before the node, which must be dropped last.
struct Ports {
    states: Subscriber<State>,
    /// `None` if all publisher slots are taken: the page is served without reports.
    reports: Option<Publisher<ConsumerReceipt>>,
    reported: Instant,
    _bus: Bus,
}

fn join(settings: &BusSettings) -> Result<Ports, BusError> {
    let bus = Bus::join(settings)?;
    let reports =
        bus.publisher().inspect_err(|error| warn!("the latency of the page is not reported: {error}"));
    Ok(Ports {
        states: bus.subscriber::<State>(1)?,
        reports: reports.ok(),
        reported: Instant::now(),
        _bus: bus,
    })
}

impl Ports {
    /// Publishes the latency report, once a second.
    fn report(&mut self, receipts: &Receipts) {
        if self.reported.elapsed() < REPORT_INTERVAL {
            return;
        }
        self.reported = Instant::now();
        let Some(reports) = &self.reports else { return };
        let result = receipts.lock().map(|mut receipts| reports.send(receipts.stamped(now_ns())));
        if let Ok(Err(error)) = result {
            warn!("the latency of the page is not reported: {error}");
            self.reports = None;
        }
    }
}

/// Receives states until `newest` is dropped, the bus fails, or its directory was replaced: a directory created again
/// holds a bus that the old ports do not reach.
fn receive_until_replaced(mut ports: Ports, root: &Path, newest: &Weak<Newest>, receipts: &Receipts) {
    let mut bus_watch = BusWatch::of(root);
    while let Some(newest) = newest.upgrade() {
        match ports.states.latest() {
            Ok(Some(state)) => {
                if let Ok(mut newest) = newest.lock() {
                    *newest = Some(state);
                }
            }
            Ok(None) => {}
            Err(error) => {
                warn!("the page lost the bus: {error}");
                std::thread::sleep(BUS_CHECK_INTERVAL);
                return;
            }
        }
        ports.report(receipts);
        if bus_watch.is_replaced() {
            // Dropping the old ports would remove files of the new bus that have the same names, so leak them.
            std::mem::forget(ports);
            return;
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// The directory of the joined bus.
pub(crate) struct BusWatch {
    bus_directory: BusDirectory,
    checked: Instant,
}

impl BusWatch {
    pub(crate) fn of(root: &Path) -> BusWatch {
        BusWatch { bus_directory: BusDirectory::read(root), checked: Instant::now() }
    }

    /// Whether the directory was replaced, checked at most once a second.
    pub(crate) fn is_replaced(&mut self) -> bool {
        self.checked.elapsed() >= BUS_CHECK_INTERVAL && self.is_replaced_now()
    }

    fn is_replaced_now(&mut self) -> bool {
        self.checked = Instant::now();
        self.bus_directory.is_replaced()
    }
}

/// The source of the frames that the page requests.
struct FrameFeed {
    newest: Weak<Newest>,
    frame_configuration: Arc<SharedFrameConfiguration>,
    receipts: Arc<Receipts>,
    requests: Arc<AtomicU64>,
    simulated: Arc<Simulated>,
}

impl FrameFeed {
    /// The frame of the newest state; `None` without a current one.
    fn frame(&self, now_ns: u64) -> Option<PageFrame> {
        self.requests.fetch_add(1, Ordering::Relaxed);
        let state = self.newest.upgrade()?.lock().ok().and_then(|newest| *newest)?;
        let state = Some(state).filter(|state| is_current(state.time_ns, now_ns, FRESH_NS))?;
        if let Ok(mut receipts) = self.receipts.lock() {
            receipts.record_once(&state, now_ns);
        }
        let frame_configuration = self.frame_configuration.lock().unwrap_or_else(PoisonError::into_inner);
        let suggested = LIBRARY.get(state.suggested_pose as usize).map(|posture| {
            let pose = SuggestedPose::on_the_spot(posture, &state.segment_origin_m);
            let name = suggestion(&state, frame_configuration.ask.as_ref()).unwrap_or(pose.name.clone());
            SuggestedPose { name, ..pose }
        });
        let mut frame = PageFrame::new(state);
        frame.suggested = suggested;
        frame.cop_sigma_target_m = frame_configuration.target_m;
        frame.plate_corners_m = frame_configuration.plate_corners_m;
        (frame.simulated, frame.cobot) = *self.simulated.lock().unwrap_or_else(PoisonError::into_inner);
        Some(frame)
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn a_state_is_displayed_only_while_it_is_current() {
        let state = State { time_ns: 5 * NS_PER_S, suggested_pose: u32::MAX, ..State::zeroed() };
        let newest = Arc::new(Newest::new(Some(state)));
        let feed = FrameFeed {
            newest: Arc::downgrade(&newest),
            frame_configuration: Arc::default(),
            receipts: Arc::new(Receipts::new(ReceiptBuilder::new(CONSUMER_NAME, 0))),
            requests: Arc::default(),
            simulated: Arc::default(),
        };
        for (now_ns, displayed) in [
            (state.time_ns - 1, false),
            (state.time_ns, true),
            (state.time_ns + FRESH_NS - 1, true),
            (state.time_ns + FRESH_NS, false),
        ] {
            assert_eq!(feed.frame(now_ns).is_some(), displayed, "{now_ns}");
        }
        assert_eq!(feed.requests.load(Ordering::Relaxed), 4, "requests are counted without a frame, too");
    }
}
