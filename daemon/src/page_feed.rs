//! Feeds the page as a consumer of the bus that receives only the newest state: it is independent of the daemon, waits
//! while none runs, and continues with the next one.

mod history;
mod station;

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use equipoise_bus::{Bus, BusError, BusSettings, Publisher, Subscriber};
use equipoise_core::message::{PickUp, State};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_view::page::{Engineer, Page, PageFrame};
use equipoise_view::suggested_pose::SuggestedPose;
use tracing::warn;

use crate::config::method::StopConfig;
use crate::config::{Config, PageConfig};
use crate::joined::Joined;
use crate::model::suggestion;
use crate::page_tokens::PageTokens;
use crate::picked_up::PickedUp;
use crate::realtime::now_ns;
use crate::status::PageFile;

/// Role of the page on the bus.
pub const PAGE_ROLE: &str = "page";
/// Consumer name in latency reports, which cover the path up to the page's server, before transmission.
pub const CONSUMER_NAME: &str = "view";
/// Polling interval for the newest state.
const LOOK_EVERY: Duration = Duration::from_millis(8);
/// Interval for checking that the joined bus still exists, and for retries of joining.
const LOOK_AFTER_THE_BUS_EVERY: Duration = Duration::from_secs(1);
/// Interval of latency reports.
const REPORT_EVERY: Duration = Duration::from_secs(1);

type Newest = Mutex<Option<State>>;
type Receipts = Mutex<PickedUp>;

/// A page being served, and the thread that feeds it. Dropping it closes connections and leaves the bus.
pub struct ServedPage {
    page: Page,
    /// The feed continues while this reference exists.
    newest: Option<Arc<Newest>>,
    threads: Vec<JoinHandle<()>>,
    asked: Arc<AtomicU64>,
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
        let desk = Arc::new(station::Desk::new(&config.station, report));
        let engineer = Engineer { station: Arc::clone(&desk) as _, command_token };
        let newest = Arc::new(Newest::default());
        let asked = Arc::new(AtomicU64::new(0));
        let receipts = Arc::new(Receipts::new(PickedUp::new(CONSUMER_NAME, now_ns())));
        let frames = frames(config, &newest, &receipts, &asked);
        let page = Page::start_with(page.listen, token, frames, Some(engineer)).context("page.listen")?;
        let feed = follow(&config.station, Arc::downgrade(&newest), receipts)?;
        let gathering = station::gather(desk, Arc::downgrade(&newest))?;
        let file = PageFile::new(&config.station, page.url(), token.is_some());
        // Without the file only `equipoise status` is affected: it does not list the page.
        if let Err(error) = file.write() {
            warn!("cannot write {}: {error}", file.path.display());
        }
        Ok(ServedPage { page, newest: Some(newest), threads: vec![feed, gathering], asked, file })
    }

    /// The page's URL for a browser.
    pub fn url(&self) -> String {
        self.page.url()
    }

    /// Whether server and feed are running.
    pub fn is_running(&self) -> bool {
        self.page.is_running() && self.threads.iter().all(|thread| !thread.is_finished())
    }

    /// Number of frames requested by the page's thread: increments sixty times a second while the thread runs.
    pub fn asked(&self) -> u64 {
        self.asked.load(Ordering::Relaxed)
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
fn follow(station: &str, newest: Weak<Newest>, receipts: Arc<Receipts>) -> anyhow::Result<JoinHandle<()>> {
    let settings = BusSettings::new(station, PAGE_ROLE);
    let (joined, first) = std::sync::mpsc::channel();
    // Ports of the bus are bound to one thread, so this thread opens them.
    let thread = std::thread::Builder::new().name("page-feed".into()).spawn(move || {
        // A failure of the first join is returned to the caller; later failures are retried.
        match join(&settings) {
            Ok(ports) => {
                let _ = joined.send(Ok(()));
                take_until_it_is_another(ports, &settings.root, &newest, &receipts);
            }
            Err(error) => {
                let _ = joined.send(Err(error));
                return;
            }
        }
        while newest.strong_count() > 0 {
            match join(&settings) {
                Ok(ports) => take_until_it_is_another(ports, &settings.root, &newest, &receipts),
                Err(error) => {
                    warn!("the page has no data: {error}");
                    std::thread::sleep(LOOK_AFTER_THE_BUS_EVERY);
                }
            }
        }
    })?;
    first.recv().map_err(|_| anyhow!("the page's feed ended before it began"))??;
    Ok(thread)
}

/// Ports are declared before the node, which must be dropped last.
struct Ports {
    states: Subscriber<State>,
    /// `None` if all publisher slots are taken: the page is served without reports.
    reports: Option<Publisher<PickUp>>,
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
        if self.reported.elapsed() < REPORT_EVERY {
            return;
        }
        self.reported = Instant::now();
        let Some(reports) = &self.reports else { return };
        let sent = receipts.lock().map(|mut receipts| reports.send(receipts.dated(now_ns())));
        if let Ok(Err(error)) = sent {
            warn!("the latency of the page is not reported: {error}");
            self.reports = None;
        }
    }
}

/// Receives states until `newest` is dropped, the bus fails, or its directory was replaced: a directory created again
/// holds a bus that the old ports do not reach.
fn take_until_it_is_another(mut ports: Ports, root: &Path, newest: &Weak<Newest>, receipts: &Receipts) {
    let mut place = Place::of(root);
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
                std::thread::sleep(LOOK_AFTER_THE_BUS_EVERY);
                return;
            }
        }
        ports.report(receipts);
        if place.is_another() {
            // Dropping the old ports would remove files of the new bus that have the same names, so leak them.
            std::mem::forget(ports);
            return;
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// The directory of the joined bus.
struct Place {
    joined: Joined,
    looked: Instant,
}

impl Place {
    fn of(root: &Path) -> Place {
        Place { joined: Joined::now(root), looked: Instant::now() }
    }

    /// Whether the directory was replaced, checked at most once a second.
    fn is_another(&mut self) -> bool {
        self.looked.elapsed() >= LOOK_AFTER_THE_BUS_EVERY && self.is_another_now()
    }

    fn is_another_now(&mut self) -> bool {
        self.looked = Instant::now();
        self.joined.is_cut_off()
    }
}

/// The frames that the page requests.
fn frames(
    config: &Config,
    newest: &Arc<Newest>,
    receipts: &Arc<Receipts>,
    asked: &Arc<AtomicU64>,
) -> impl FnMut() -> Option<PageFrame> + Send + 'static {
    let (newest, receipts, asked) = (Arc::downgrade(newest), Arc::clone(receipts), Arc::clone(asked));
    let target_m = (config.identification.stop == StopConfig::PredictedCop)
        .then_some(config.identification.stop_cop_sigma_mm * 1e-3);
    let ask = config.loaded_model.as_ref().and_then(|model| model.file().ask.clone());
    move || {
        asked.fetch_add(1, Ordering::Relaxed);
        let state = newest.upgrade()?.lock().ok().and_then(|newest| *newest)?;
        if let Ok(mut receipts) = receipts.lock() {
            receipts.enter_once(&state, now_ns());
        }
        let suggested = LIBRARY.get(state.suggested_pose as usize).map(|posture| {
            let pose = SuggestedPose::on_the_spot(posture, &state.segment_origin_m);
            SuggestedPose { name: suggestion(&state, ask.as_ref()).unwrap_or(pose.name.clone()), ..pose }
        });
        let mut frame = PageFrame::new(state);
        frame.suggested = suggested;
        frame.cop_sigma_target_m = target_m;
        Some(frame)
    }
}
