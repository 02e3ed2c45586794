//! Demonstration without hardware: simulated humans with real network protocols, the real daemon and the real page.
//!
//! The simulated human reacts to the published state as a worker would: assumes the suggested poses, stands in poses
//! that were not used for identification, then lifts boxes, or holds a part that a simulated cobot presents. Two of
//! different build take turns.

mod cobot;
mod lift;
mod scene;
pub mod summary;
mod viewer;

use std::cmp::Ordering;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_bus::{Bus, BusSettings, Channel, Listener, Subscriber};
use equipoise_config::Config;
use equipoise_core::message::State;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_daemon::pipeline::Pipeline;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::{Simulation, SimulationHandle};
use equipoise_view::page::{LiftResult, SimulatedHuman};
use equipoise_view::terminal::live_line;

use crate::page_feed::ServedPage;
use cobot::{Arm, Handovers};
use scene::{Pace, Scene, Script};
use summary::{DemoSummary, page_results};
use viewer::{StartSignal, open_browser};

/// Default port of the page, if it is free.
const PAGE_PORT: u16 = 8017;
/// Interval between live lines.
const LINE_INTERVAL: Duration = Duration::from_millis(1000);
/// Maximum duration of a pass, from its start signal.
const PASS_LIMIT: Duration = Duration::from_secs(240);

/// Settings of the demonstration.
#[derive(Debug, Clone)]
pub struct DemoSettings {
    /// Seed of all random numbers. Odd and even seeds have different builds.
    pub seed: u64,
    /// Name of the station.
    pub station: String,
    /// One pass with the human of the seed, at once and as fast as the results permit. Otherwise the humans of this seed
    /// and the next one take turns until a signal or the end of the duration.
    pub once: bool,
    /// A simulated cobot presents a part instead of the boxes.
    pub cobot: bool,
    /// Maximum duration; of one pass 240 s if absent.
    pub duration: Option<Duration>,
    /// Address of the page; `None` for no page.
    pub page: Option<SocketAddr>,
    /// The page is for a person: open it in a browser, wait for a viewer, and act as slowly as one reads.
    pub for_viewer: bool,
    /// Print live lines.
    pub verbose: bool,
}

/// A build of a simulated human.
#[derive(Debug, Clone, Copy)]
struct Build {
    height_m: f64,
    mass_kg: f64,
}

/// The builds that take turns.
const BUILDS: [Build; 2] = [Build { height_m: 1.77, mass_kg: 72.0 }, Build { height_m: 1.92, mass_kg: 98.0 }];

/// Default address of the page; uses another free port if the default is taken.
pub fn default_page() -> SocketAddr {
    let preferred = SocketAddr::from((Ipv4Addr::LOCALHOST, PAGE_PORT));
    let free = std::net::TcpListener::bind(preferred).is_ok();
    if free { preferred } else { SocketAddr::from((Ipv4Addr::LOCALHOST, 0)) }
}

/// Runs the demonstration; `report` receives what each complete pass showed. Returns the number of passes.
///
/// # Errors
/// What could not be started, what the demonstration failed to show, or an error of `report`.
pub fn run(
    settings: &DemoSettings,
    stop: &AtomicBool,
    report: impl FnMut(&DemoSummary) -> anyhow::Result<()>,
) -> anyhow::Result<u64> {
    let [suit, plate] = [
        free_address().context("no free port for the suit")?,
        free_address().context("no free port for the plate")?,
    ];
    let config = config(settings, suit, plate, BUILDS[0])?;
    let page =
        config.page.as_ref().map(|page| ServedPage::start(&config, page, Path::new(""))).transpose()?;
    let start = if settings.for_viewer { StartSignal::awaited() } else { StartSignal::given() };
    let arm = settings.cobot.then(Arm::start).transpose()?;
    let (once, begun) = (settings.once, Instant::now());
    let mut show = Show { settings, stop, begun, suit, plate, page, start, once, results: Vec::new(), arm };
    show.announce();
    let outcome = show.run(report);
    if let Some(page) = show.page.take() {
        page.end(&show.results);
    }
    outcome
}

/// The demonstration in progress.
struct Show<'a> {
    settings: &'a DemoSettings,
    stop: &'a AtomicBool,
    begun: Instant,
    suit: SocketAddr,
    plate: SocketAddr,
    page: Option<ServedPage>,
    start: StartSignal,
    /// Whether it ends after one pass.
    once: bool,
    /// The last results of each simulated human and box.
    results: Vec<LiftResult>,
    /// The simulated cobot; a script has it while it is played.
    arm: Option<Arm>,
}

/// Subscriptions through which the simulated human follows the daemon.
struct Subscriptions {
    states: Subscriber<State>,
    wake: Listener,
}

impl Show<'_> {
    fn announce(&mut self) {
        if !self.settings.verbose {
            return;
        }
        let Some(page) = &self.page else {
            println!("no page (--headless)");
            return;
        };
        println!("page: {}", page.url());
        if self.settings.for_viewer {
            let opened = open_browser(&page.url());
            if !opened && !self.start.takes_a_key() {
                println!("Neither a terminal nor a desktop: one pass, without waiting for a viewer.");
                (self.start, self.once) = (StartSignal::given(), true);
                return;
            }
            let browser = if opened { "it opens in your browser" } else { "open it in a browser" };
            let key =
                if self.start.takes_a_key() { ", or press Enter to start without a viewer" } else { "" };
            println!("The demo starts with the first viewer of the page: {browser}{key}. Ctrl-C ends.");
        }
    }

    fn run(&mut self, mut report: impl FnMut(&DemoSummary) -> anyhow::Result<()>) -> anyhow::Result<u64> {
        let mut passes = 0;
        while let Some(summary) = self.pass(passes)? {
            report(&summary)?;
            // On a busy machine a pass may be incomplete; the next one follows.
            if self.once && !summary.complete {
                bail!(
                    "the demo is not complete: no valid torque with one of the loads, or no static pose without a load \
                     was published; see `equipoise doctor` for the load of this machine"
                );
            }
            passes += 1;
            if self.once {
                break;
            }
        }
        Ok(passes)
    }

    /// One simulated human; `None` if the demonstration was ended meanwhile.
    fn pass(&mut self, pass: u64) -> anyhow::Result<Option<DemoSummary>> {
        let seed = self.settings.seed.wrapping_add(pass % BUILDS.len() as u64);
        let build = BUILDS[(seed.wrapping_sub(1) % BUILDS.len() as u64) as usize];
        let human = SimulatedHuman { height_m: build.height_m, mass_kg: build.mass_kg, box_kg: None };
        let mut simulated = SimulationSettings {
            height_m: build.height_m,
            mass_kg: build.mass_kg,
            ..SimulationSettings::default().realistic(seed)
        };
        simulated.suit.target = self.suit;
        simulated.plate.address = self.plate;
        let person = Simulation::start(simulated).context("the simulated human")?;
        let config = config(self.settings, self.suit, self.plate, build)?;
        let pipeline = Pipeline::start(&config)?;
        let bus = Bus::join(&BusSettings::new(&self.settings.station, "worker"))?;
        let subscriptions =
            Subscriptions { states: bus.subscriber(64)?, wake: bus.listener(Channel::Results)? };
        let arm = self.arm.take();
        let handovers =
            arm.map(|arm| Handovers::new(arm, &bus, seed, config.settings().limits)).transpose()?;
        let script = self.play(subscriptions, &person, human, handovers);
        // Stop the daemon first, or its last cycles would report silent sensors.
        let pipeline = pipeline.stop();
        person.stop().context("the simulated human")?;
        let (script, pipeline) = (script?, pipeline?);
        for result in page_results(&script, human) {
            self.results.retain(|earlier| earlier.human != result.human);
            self.results.push(result);
        }
        let key = |result: &LiftResult| (result.human.height_m, result.human.box_kg.unwrap_or_default());
        self.results.sort_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(Ordering::Equal));
        let is_over = script.scene() == Scene::Over;
        let summary = is_over.then(|| DemoSummary::of(&script, human, &pipeline));
        self.arm = script.handovers.map(Handovers::into_arm);
        Ok(summary)
    }

    /// Plays the script to its end, or until the demonstration is ended.
    fn play(
        &mut self,
        mut subscriptions: Subscriptions,
        person: &SimulationHandle,
        human: SimulatedHuman,
        handovers: Option<Handovers>,
    ) -> anyhow::Result<Script> {
        let DemoSettings { duration, verbose, for_viewer, .. } = *self.settings;
        let once = self.once;
        let limit = duration.filter(|_| once).unwrap_or(PASS_LIMIT);
        let pace = if for_viewer && !once { Pace::READABLE } else { Pace::FAST };
        let mut script = Script::new(pace, handovers);
        let (mut started, mut last_line) = (None, Instant::now());
        while script.scene() != Scene::Over {
            if self.stop.load(Relaxed) && once {
                bail!("stopped before the end; nothing to summarise");
            }
            let is_ended = duration.is_some_and(|duration| self.begun.elapsed() > duration);
            if !once && (is_ended || self.stop.load(Relaxed)) {
                return Ok(script);
            }
            if started.is_none() && self.start.is_given(self.page.as_ref()) {
                started = Some(Instant::now());
            }
            let elapsed = started.map_or(Duration::ZERO, |started| started.elapsed());
            if elapsed > limit {
                bail!(
                    "{} s were not enough: still {} with {} poses{}; give it more with --once --duration",
                    limit.as_secs(),
                    script.scene().name(),
                    script.poses_used(),
                    script.masked_by()
                );
            }
            subscriptions.wake.wait(Duration::from_millis(100))?;
            let scene = script.scene();
            while let Some(state) = subscriptions.states.receive()? {
                script.update(&state, person, elapsed.as_secs_f64(), started.is_some())?;
                if verbose && started.is_some() && last_line.elapsed() >= LINE_INTERVAL {
                    last_line = Instant::now();
                    let pose = LIBRARY.get(state.suggested_pose as usize).map(|posture| posture.name);
                    println!("{:5.1} s  {}", elapsed.as_secs_f64(), live_line(&state, pose));
                }
            }
            if let Some(page) = &self.page {
                page.set_simulated(SimulatedHuman { box_kg: script.box_kg(), ..human }, script.cobot());
            }
            if verbose && script.scene() != scene && script.scene() != Scene::Over {
                println!("{:.2} m, {:.0} kg: {}", human.height_m, human.mass_kg, script.scene().name());
            }
        }
        Ok(script)
    }
}

/// The configuration of the demonstration, in its minimal form.
fn config(
    settings: &DemoSettings,
    suit: SocketAddr,
    plate: SocketAddr,
    build: Build,
) -> anyhow::Result<Config> {
    let page = settings.page.map_or_else(String::new, |page| format!("[page]\nlisten = \"{page}\"\n"));
    let Build { height_m, mass_kg } = build;
    let text = format!(
        r#"
station = "{}"
[suit]
source = "mvn-udp"
listen = "{suit}"
[ground]
source = "ati-rdt"
address = "{plate}"
counts_per_newton = 1000000
counts_per_newton_metre = 1000000
measures = "action"
[ground.frame]
size_m = [0.6, 0.6]
[subject]
id = "demo"
height_m = {height_m}
mass_kg = {mass_kg}
sex = "male"
save_profile = false
[latency]
flight_cycles = 0
{page}"#,
        settings.station
    );
    Ok(Config::parse(&text, "the demonstration's configuration")?)
}
