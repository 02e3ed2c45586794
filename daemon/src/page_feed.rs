//! The page as one more consumer of the bus, that takes the newest state and nothing else: it belongs to no daemon, waits
//! while there is none, and goes on when the next one comes.

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

/// The role under which the page is found on the bus.
pub const PAGE_ROLE: &str = "page";
/// What it calls itself when it reports how late states come: to the page's server, which has not sent them yet.
pub const CONSUMER_NAME: &str = "view";
/// How often the newest state is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(8);
/// How often it is looked whether the bus is still the one that was joined, and how soon joining is tried again.
const LOOK_AFTER_THE_BUS_EVERY: Duration = Duration::from_secs(1);
/// How often it is reported.
const REPORT_EVERY: Duration = Duration::from_secs(1);

type Newest = Mutex<Option<State>>;
type Told = Mutex<PickedUp>;

/// A page being served, and the thread that feeds it. Dropping it ends open connections and leaves the bus.
pub struct ServedPage {
    page: Page,
    /// Held so that the feed goes on.
    newest: Option<Arc<Newest>>,
    threads: Vec<JoinHandle<()>>,
    asked: Arc<AtomicU64>,
    file: PageFile,
}

impl ServedPage {
    /// Serves the page of a configuration; `base` is the folder that a relative `token_file` counts from.
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
        let told = Arc::new(Told::new(PickedUp::new(CONSUMER_NAME, now_ns())));
        let frames = frames(config, &newest, &told, &asked);
        let page = Page::start_with(page.listen, token, frames, Some(engineer)).context("page.listen")?;
        let feed = follow(&config.station, Arc::downgrade(&newest), told)?;
        let gathering = station::gather(desk, Arc::downgrade(&newest))?;
        let file = PageFile::new(&config.station, page.url(), token.is_some());
        // Without it `equipoise status` does not name the page; all else works.
        if let Err(error) = file.write() {
            warn!("cannot write {}: {error}", file.path.display());
        }
        Ok(ServedPage { page, newest: Some(newest), threads: vec![feed, gathering], asked, file })
    }

    /// What to type into a browser.
    pub fn url(&self) -> String {
        self.page.url()
    }

    /// Whether the page is still served and fed.
    pub fn is_running(&self) -> bool {
        self.page.is_running() && self.threads.iter().all(|thread| !thread.is_finished())
    }

    /// How often the page's thread has asked for a frame: grows sixty times a second as long as it lives.
    pub fn asked(&self) -> u64 {
        self.asked.load(Ordering::Relaxed)
    }
}

impl Drop for ServedPage {
    fn drop(&mut self) {
        self.newest = None;
        for thread in self.threads.drain(..) {
            // A panic was printed by its own thread.
            let _ = thread.join();
        }
        self.file.remove();
    }
}

/// Starts the thread that takes the newest state of a station off the bus; it ends once nobody holds `newest`.
fn follow(station: &str, newest: Weak<Newest>, told: Arc<Told>) -> anyhow::Result<JoinHandle<()>> {
    let settings = BusSettings::new(station, PAGE_ROLE);
    let (joined, first) = std::sync::mpsc::channel();
    // The bus's ports belong to one thread, so this one has them.
    let thread = std::thread::Builder::new().name("page-feed".into()).spawn(move || {
        // That the bus cannot be joined at all is for whoever starts the page; later it is waited out.
        match join(&settings) {
            Ok(ports) => {
                let _ = joined.send(Ok(()));
                take_until_it_is_another(ports, &settings.root, &newest, &told);
            }
            Err(error) => {
                let _ = joined.send(Err(error));
                return;
            }
        }
        while newest.strong_count() > 0 {
            match join(&settings) {
                Ok(ports) => take_until_it_is_another(ports, &settings.root, &newest, &told),
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

/// Ports die before the node they hang on.
struct Ports {
    states: Subscriber<State>,
    /// `None` if all places are taken: the page is served all the same.
    reports: Option<Publisher<PickUp>>,
    reported: Instant,
    _bus: Bus,
}

fn join(settings: &BusSettings) -> Result<Ports, BusError> {
    let bus = Bus::join(settings)?;
    let reports = bus.publisher().inspect_err(|error| warn!("how late the page is, is not told: {error}"));
    Ok(Ports {
        states: bus.subscriber::<State>(1)?,
        reports: reports.ok(),
        reported: Instant::now(),
        _bus: bus,
    })
}

impl Ports {
    /// Tells how late states came so far, once a second.
    fn report(&mut self, told: &Told) {
        if self.reported.elapsed() < REPORT_EVERY {
            return;
        }
        self.reported = Instant::now();
        let Some(reports) = &self.reports else { return };
        let sent = told.lock().map(|mut told| reports.send(told.dated(now_ns())));
        if let Ok(Err(error)) = sent {
            warn!("how late the page is, is not told: {error}");
            self.reports = None;
        }
    }
}

/// Takes states until nobody wants them, or the bus breaks, or its directory is not the one that was joined: whoever
/// removed it and started a daemon anew has a bus that the old ports do not see.
fn take_until_it_is_another(mut ports: Ports, root: &Path, newest: &Weak<Newest>, told: &Told) {
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
        ports.report(told);
        if place.is_another() {
            // To leave would take away what the next bus has under the same names: the old ports are let go of.
            std::mem::forget(ports);
            return;
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// The directory of the bus that was joined.
struct Place {
    joined: Joined,
    looked: Instant,
}

impl Place {
    fn of(root: &Path) -> Place {
        Place { joined: Joined::now(root), looked: Instant::now() }
    }

    /// Whether another directory stands there, as of at most a second ago.
    fn is_another(&mut self) -> bool {
        self.looked.elapsed() >= LOOK_AFTER_THE_BUS_EVERY && self.is_another_now()
    }

    fn is_another_now(&mut self) -> bool {
        self.looked = Instant::now();
        self.joined.is_cut_off()
    }
}

/// What the page is told when it asks.
fn frames(
    config: &Config,
    newest: &Arc<Newest>,
    told: &Arc<Told>,
    asked: &Arc<AtomicU64>,
) -> impl FnMut() -> Option<PageFrame> + Send + 'static {
    let (newest, told, asked) = (Arc::downgrade(newest), Arc::clone(told), Arc::clone(asked));
    let target_m = (config.identification.stop == StopConfig::PredictedCop)
        .then_some(config.identification.stop_cop_sigma_mm * 1e-3);
    let ask = config.loaded_model.as_ref().and_then(|model| model.file().ask.clone());
    move || {
        asked.fetch_add(1, Ordering::Relaxed);
        let state = newest.upgrade()?.lock().ok().and_then(|newest| *newest)?;
        if let Ok(mut told) = told.lock() {
            told.enter_once(&state, now_ns());
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
