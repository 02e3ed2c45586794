//! Demonstration without hardware: a simulated person with real network protocols, the real daemon and the real page.
//!
//! The simulated human reacts to the published state as a worker would: assumes the suggested poses, stands in poses
//! that were not used for identification, then lifts a box as in the paper.

mod scene;
pub mod summary;

use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_bus::{Bus, BusSettings, Channel, Subscriber};
use equipoise_config::Config;
use equipoise_core::message::State;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_daemon::pipeline::Pipeline;
use equipoise_simulator::ports::free_address;
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::{Simulation, SimulationHandle};
use equipoise_view::terminal::live_line;

use crate::page_feed::ServedPage;
use scene::{Scene, Script};
use summary::DemoSummary;

/// Default port of the page, if it is free.
const PAGE_PORT: u16 = 8017;
/// Interval between live lines.
const LINE_INTERVAL: Duration = Duration::from_millis(1000);

/// Settings of the demonstration.
#[derive(Debug, Clone)]
pub struct DemoSettings {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Name of the station.
    pub station: String,
    /// Maximum duration.
    pub duration: Duration,
    /// Address of the page; `None` for no page.
    pub page: Option<SocketAddr>,
    /// Print live lines.
    pub verbose: bool,
}

/// Default address of the page; uses another free port if the default is taken.
pub fn default_page() -> SocketAddr {
    let preferred = SocketAddr::from((Ipv4Addr::LOCALHOST, PAGE_PORT));
    let free = std::net::TcpListener::bind(preferred).is_ok();
    if free { preferred } else { SocketAddr::from((Ipv4Addr::LOCALHOST, 0)) }
}

/// Runs the demonstration.
///
/// # Errors
/// What could not be started, or what the demonstration failed to show.
pub fn run(settings: &DemoSettings, stop: &AtomicBool) -> anyhow::Result<DemoSummary> {
    let suit_port = free_address().context("a port for the suit")?;
    let mut simulated = SimulationSettings::default().realistic(settings.seed);
    simulated.suit.target = suit_port;
    simulated.plate.address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let person = Simulation::start(simulated).context("the simulated person")?;
    let config = config(settings, suit_port, person.plate_address())?;
    let page = config.page.as_ref().map(|page| ServedPage::start(&config, page, Path::new("")));
    let page = page.transpose()?;
    let pipeline = Pipeline::start(&config)?;
    if settings.verbose {
        match &page {
            Some(page) => println!("page: {}", page.url()),
            None => println!("no page (--headless)"),
        }
    }
    let bus = Bus::join(&BusSettings::new(&settings.station, "worker"))?;
    let subscriptions = Subscriptions { states: bus.subscriber(64)?, wake: bus.listener(Channel::Results)? };
    let script = play(settings, stop, subscriptions, &person);
    drop(bus);
    // Stop the daemon first, or its last cycles would report silent sensors.
    let pipeline = pipeline.stop();
    drop(page);
    person.stop().context("the simulated person")?;
    let script = script?;
    let pipeline = pipeline?;
    Ok(DemoSummary::of(script, &pipeline))
}

/// Subscriptions through which the simulated person follows the daemon.
struct Subscriptions {
    states: Subscriber<State>,
    wake: equipoise_bus::Listener,
}

fn play(
    settings: &DemoSettings,
    stop: &AtomicBool,
    mut subscriptions: Subscriptions,
    person: &SimulationHandle,
) -> anyhow::Result<Script> {
    let (started, mut last_line) = (Instant::now(), Instant::now());
    let mut script = Script::new(settings.duration);
    while script.scene() != Scene::Over {
        if stop.load(Ordering::Relaxed) {
            bail!("stopped before the end; nothing to summarise");
        }
        if started.elapsed() > settings.duration {
            bail!(
                "{} s were not enough: still {} with {} poses; give it more with --duration",
                settings.duration.as_secs(),
                script.scene().name(),
                script.poses_used()
            );
        }
        subscriptions.wake.wait(Duration::from_millis(100))?;
        while let Some(state) = subscriptions.states.receive()? {
            script.update(&state, person, started.elapsed());
            if settings.verbose && last_line.elapsed() >= LINE_INTERVAL {
                last_line = Instant::now();
                let pose = LIBRARY.get(state.suggested_pose as usize).map(|posture| posture.name);
                println!("{:5.1} s  {}", started.elapsed().as_secs_f64(), live_line(&state, pose));
            }
        }
    }
    Ok(script)
}

/// The configuration of the demonstration, in its minimal form.
fn config(settings: &DemoSettings, suit: SocketAddr, plate: SocketAddr) -> anyhow::Result<Config> {
    let page = settings.page.map_or_else(String::new, |page| format!("[page]\nlisten = \"{page}\"\n"));
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
height_m = 1.77
mass_kg = 72.0
sex = "male"
save_profile = false
[latency]
flight_cycles = 0
{page}"#,
        settings.station
    );
    Ok(Config::parse(&text, "the demonstration's configuration")?)
}
