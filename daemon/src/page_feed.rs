//! The page as one more consumer of the bus, that takes the newest state and nothing else: it belongs to no daemon, waits
//! while there is none, and goes on when the next one comes.

use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use equipoise_bus::{Bus, BusError, BusSettings, Subscriber};
use equipoise_core::body::Skeleton;
use equipoise_core::message::State;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_view::page::{Page, PageFrame, Token};
use equipoise_view::suggested_pose::SuggestedPose;
use tracing::warn;

use crate::config::method::StopConfig;
use crate::config::{Config, PageConfig};
use crate::model::suggestion;
use crate::status::PageFile;

/// The role under which the page is found on the bus.
pub const PAGE_ROLE: &str = "page";
/// How often the newest state is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// How often it is looked whether the bus is still the one that was joined, and how soon joining is tried again.
const LOOK_AFTER_THE_BUS_EVERY: Duration = Duration::from_secs(1);

type Newest = Mutex<Option<State>>;

/// A page being served, and the thread that feeds it. Dropping it ends open connections and leaves the bus.
pub struct ServedPage {
    page: Page,
    /// Held so that the feed goes on.
    newest: Option<Arc<Newest>>,
    feed: Option<JoinHandle<()>>,
    asked: Arc<AtomicU64>,
    file: PageFile,
}

impl ServedPage {
    /// Serves the page of a configuration; `base` is the folder that a relative `token_file` counts from.
    ///
    /// # Errors
    /// The port is taken, the token cannot be used, or the bus cannot be joined.
    pub fn start(config: &Config, page: &PageConfig, base: &Path) -> anyhow::Result<ServedPage> {
        let token = page.token_file.as_ref().map(|file| Token::read(&base.join(file))).transpose();
        let token = token.context("page.token_file")?;
        let newest = Arc::new(Newest::default());
        let asked = Arc::new(AtomicU64::new(0));
        let frames = frames(config, &newest, &asked);
        let page = Page::start_for(page.listen, token, frames).context("page.listen")?;
        let feed = follow(&config.station, Arc::downgrade(&newest))?;
        let file = PageFile::new(&config.station, page.url(), token.is_some());
        // Without it `equipoise status` does not name the page; all else works.
        if let Err(error) = file.write() {
            warn!("cannot write {}: {error}", file.path.display());
        }
        Ok(ServedPage { page, newest: Some(newest), feed: Some(feed), asked, file })
    }

    /// What to type into a browser.
    pub fn url(&self) -> String {
        self.page.url()
    }

    /// Whether the page is still served and fed.
    pub fn is_running(&self) -> bool {
        self.page.is_running() && self.feed.as_ref().is_some_and(|feed| !feed.is_finished())
    }

    /// How often the page's thread has asked for a frame: grows thirty times a second as long as it lives.
    pub fn asked(&self) -> u64 {
        self.asked.load(Ordering::Relaxed)
    }
}

impl Drop for ServedPage {
    fn drop(&mut self) {
        self.newest = None;
        if let Some(feed) = self.feed.take() {
            // A panic was printed by its own thread.
            let _ = feed.join();
        }
        self.file.remove();
    }
}

/// Starts the thread that takes the newest state of a station off the bus; it ends once nobody holds `newest`.
fn follow(station: &str, newest: Weak<Newest>) -> anyhow::Result<JoinHandle<()>> {
    let settings = BusSettings::new(station, PAGE_ROLE);
    let (joined, first) = std::sync::mpsc::channel();
    // The bus's ports belong to one thread, so this one has them.
    let thread = std::thread::Builder::new().name("page-feed".into()).spawn(move || {
        // That the bus cannot be joined at all is for whoever starts the page; later it is waited out.
        match join(&settings) {
            Ok(ports) => {
                let _ = joined.send(Ok(()));
                take_until_it_is_another(ports, &settings.root, &newest);
            }
            Err(error) => {
                let _ = joined.send(Err(error));
                return;
            }
        }
        while newest.strong_count() > 0 {
            match join(&settings) {
                Ok(ports) => take_until_it_is_another(ports, &settings.root, &newest),
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

/// The subscriber dies before the node it hangs on.
struct Ports {
    states: Subscriber<State>,
    _bus: Bus,
}

fn join(settings: &BusSettings) -> Result<Ports, BusError> {
    let bus = Bus::join(settings)?;
    Ok(Ports { states: bus.subscriber::<State>(1)?, _bus: bus })
}

/// Takes states until nobody wants them, or the bus breaks, or its directory is not the one that was joined: whoever
/// removed it and started a daemon anew has a bus that the old ports do not see.
fn take_until_it_is_another(mut ports: Ports, root: &Path, newest: &Weak<Newest>) {
    let directory = || std::fs::metadata(root).ok().map(|found| (found.dev(), found.ino()));
    let (joined, mut looked) = (directory(), Instant::now());
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
        if looked.elapsed() >= LOOK_AFTER_THE_BUS_EVERY {
            looked = Instant::now();
            if directory() != joined {
                // To leave would take away what the next bus has under the same names: the old ports are let go of.
                std::mem::forget(ports);
                return;
            }
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// What the page is told when it asks.
fn frames(
    config: &Config,
    newest: &Arc<Newest>,
    asked: &Arc<AtomicU64>,
) -> impl FnMut() -> Option<PageFrame> + Send + 'static {
    let (newest, asked) = (Arc::downgrade(newest), Arc::clone(asked));
    let skeleton = Skeleton::nominal(config.subject.height_m);
    let target_m = (config.identification.stop == StopConfig::PredictedCop)
        .then_some(config.identification.stop_cop_sigma_mm * 1e-3);
    let ask = config.loaded_model.as_ref().and_then(|model| model.file().ask.clone());
    move || {
        asked.fetch_add(1, Ordering::Relaxed);
        let state = newest.upgrade()?.lock().ok().and_then(|newest| *newest)?;
        let suggested = LIBRARY.get(state.suggested_pose as usize).map(|posture| {
            let pose = SuggestedPose::on_the_spot(posture, &skeleton, &state.segment_origin_m);
            SuggestedPose { name: suggestion(&state, ask.as_ref()).unwrap_or(pose.name.clone()), ..pose }
        });
        let mut frame = PageFrame::new(state);
        frame.suggested = suggested;
        frame.cop_sigma_target_m = target_m;
        Some(frame)
    }
}
