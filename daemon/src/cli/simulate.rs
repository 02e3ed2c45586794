//! `equipoise simulate`: the simulated person alone, on the real wires, or a recorded one.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_adapters::capture::CsvCapture;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::plate::Plate;
use equipoise_simulator::player::{self, PlayerSettings, Recorded};
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::Simulation;

use super::Outcome;

/// How long each pose takes, with getting there, s.
const POSE_S: f64 = 4.0;

/// Send a simulated or recorded person's datagrams: MVN over UDP, force plate over RDT
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise simulate --suit 127.0.0.1:9763 --plate 127.0.0.1:49152\n  equipoise simulate \
                  --play motion.csv"
)]
pub(super) struct Arguments {
    /// Where the suit's datagrams go
    #[arg(long, default_value = "127.0.0.1:9763", value_name = "ADDRESS")]
    suit: SocketAddr,
    /// Where the plate listens for requests
    #[arg(long, default_value = "127.0.0.1:49152", value_name = "ADDRESS")]
    plate: SocketAddr,
    /// End after this many seconds
    #[arg(long = "for", value_name = "SECONDS", value_parser = super::seconds)]
    seconds: Option<f64>,
    /// Another seed is another person
    #[arg(long, default_value_t = 1, conflicts_with = "play")]
    seed: u64,
    /// Stature, m
    #[arg(long, default_value_t = 1.77, conflicts_with = "play")]
    height_m: f64,
    /// Body mass, kg
    #[arg(long, default_value_t = 72.0, conflicts_with = "play")]
    mass_kg: f64,
    /// Samples of the suit a second
    #[arg(long, default_value_t = 60.0, conflicts_with = "play")]
    suit_rate_hz: f64,
    /// Play a recorded motion (CSV) instead
    #[arg(long, value_name = "FILE")]
    play: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let limits = [
        ("--height-m", arguments.height_m, 1.2..=2.2),
        ("--mass-kg", arguments.mass_kg, 30.0..=200.0),
        ("--suit-rate-hz", arguments.suit_rate_hz, 10.0..=1000.0),
    ];
    for (name, value, range) in limits {
        if !range.contains(&value) {
            bail!("{name} {value} is not between {} and {}", range.start(), range.end());
        }
    }
    match &arguments.play {
        Some(path) => play(arguments, path.clone()),
        None => simulate(arguments),
    }
}

fn simulate(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let mut settings = SimulationSettings {
        seed: arguments.seed,
        height_m: arguments.height_m,
        mass_kg: arguments.mass_kg,
        ..SimulationSettings::default()
    };
    settings.suit.target = arguments.suit;
    settings.suit.rate_hz = arguments.suit_rate_hz;
    settings.plate.address = arguments.plate;
    let stop = super::run::stop_on_signals()?;
    let person = Simulation::start(settings).with_context(|| format!("the plate at {}", arguments.plate))?;
    println!("suit to {}, plate at {}; Ctrl-C ends", arguments.suit, person.plate_address());
    let (started, mut poses) = (Instant::now(), 0);
    while !stop.load(Ordering::Relaxed)
        && arguments.seconds.is_none_or(|seconds| started.elapsed().as_secs_f64() < seconds)
    {
        // Through the library, round and round.
        if started.elapsed().as_secs_f64() > POSE_S * poses as f64 {
            person.take_pose(poses % LIBRARY.len())?;
            poses += 1;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    person.stop()?;
    Ok(Outcome::Done)
}

fn play(arguments: &Arguments, path: PathBuf) -> anyhow::Result<Outcome> {
    let mut capture = CsvCapture::open(&path)?;
    let mut samples = Vec::new();
    for (suit, ground) in capture.by_ref() {
        let time_s = equipoise_core::time::seconds(suit.sample_time_ns);
        samples.push((time_s, Recorded::Ground(ground)));
        samples.push((time_s, Recorded::Suit(Box::new(suit))));
    }
    let rejected = capture.rejected().total();
    if samples.is_empty() {
        bail!("{} has no rows that can be played; {rejected} were rejected", path.display());
    }
    let settings = PlayerSettings {
        suit_target: arguments.suit,
        plate_address: arguments.plate,
        plate: Plate::default(),
        speed: 1.0,
        wait_for_client: true,
        faults: equipoise_simulator::faults::Faults::default(),
        seed: 0,
    };
    let stop = super::run::stop_on_signals()?;
    let player =
        player::play(samples, settings).with_context(|| format!("the plate at {}", arguments.plate))?;
    println!(
        "suit to {}, plate at {}; waits until the plate is asked",
        arguments.suit,
        player.plate_address()
    );
    let started = Instant::now();
    while !stop.load(Ordering::Relaxed)
        && !player.is_finished()
        && arguments.seconds.is_none_or(|seconds| started.elapsed().as_secs_f64() < seconds)
    {
        std::thread::sleep(Duration::from_millis(50));
    }
    let [suit, plate] = player.stop()?;
    println!("played {suit} suit samples and {plate} plate samples; {rejected} rows were rejected");
    Ok(if rejected > 0 { Outcome::PartRejected } else { Outcome::Done })
}
