//! `equipoise simulate`: the simulated person alone, on the real wires, or a recorded one; or a simulated cobot.

mod cobot;
mod ground;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_adapters::capture::CsvCapture;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::devices::running::{Pace, Running};
use equipoise_simulator::plate::Plate;
use equipoise_simulator::player::{self, PlayerSettings, Recorded};
use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::{OnPlates, Simulation, SimulationHandle};
use equipoise_simulator::walk::StandingPosition;

use super::Outcome;

/// The last message before the simulation runs.
const ENDS: &str = "Ctrl-C ends";
/// How long each pose takes, with getting there, s.
const POSE_S: f64 = 4.0;

/// Send a simulated or recorded person onto the wires of real sensors: MVN's suit, and any device under the feet
#[derive(Debug, clap::Args)]
#[command(
    after_help = "With --ground the section of the configuration that fits the device is printed.\n\nExamples:\n  equipoise \
                  simulate --suit 127.0.0.1:9763 --plate 127.0.0.1:49152\n  equipoise simulate --ground amti-serial \
                  --ground-address /tmp/plate\n  equipoise simulate --ground text --ground-address udp:127.0.0.1:8888 \
                  --suit-tcp\n  equipoise simulate --play motion.csv\n  equipoise simulate \
                  --cobot 127.0.0.1:30004"
)]
pub(super) struct Arguments {
    /// Where the suit's datagrams go
    #[arg(long, default_value = "127.0.0.1:9763", value_name = "ADDRESS")]
    suit: SocketAddr,
    /// Connect to the suit's receiver over TCP instead of sending datagrams
    #[arg(long, conflicts_with = "play")]
    suit_tcp: bool,
    /// What measures the force under the feet
    #[arg(long, value_enum, value_name = "DEVICE", conflicts_with_all = ["play", "plate"])]
    ground: Option<ground::Kind>,
    /// Where it is: an address, `udp:ADDRESS` or `tcp:ADDRESS`, or for a serial line the name that it gets
    #[arg(long, value_name = "PLACE", requires = "ground")]
    ground_address: Option<String>,
    /// Two of it, one under each foot; the second is one port on, or has `-2` behind its name
    #[arg(long, requires = "ground")]
    two: bool,
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
    /// What the person does, over and over
    #[arg(long = "do", value_enum, default_value_t = Does::Poses, conflicts_with = "play")]
    does: Does,
    /// Play a recorded motion (CSV) instead
    #[arg(long, value_name = "FILE")]
    play: Option<PathBuf>,
    #[command(flatten)]
    cobot: cobot::CobotArguments,
}

/// What the simulated person does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Does {
    /// Takes the poses of the library, to be identified
    Poses,
    /// Picks up a box of 6 kg, shows it around and puts it down, then others of 11, 14 and 20 kg
    Lifts,
    /// Stands at the corners of the plate and turns in its middle, for `equipoise register`
    Corners,
    /// Stamps a foot down, for `equipoise stomp`
    Stomps,
    /// Leaves the plate, for `equipoise tare`
    Away,
    /// Leaves the plate and puts 20 kg on it at four corners, for `equipoise verify --mass 20`
    Weights,
    /// Leaves the plate and leans a rod on it, for `equipoise verify --rod`
    Rod,
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
    if arguments.ground.is_some() && matches!(arguments.does, Does::Away | Does::Weights | Does::Rod) {
        bail!("--do away, weights and rod need the plate that is there without --ground");
    }
    match (&arguments.play, arguments.cobot.address()) {
        (_, Some(address)) => cobot::run(&arguments.cobot, address, arguments.seconds),
        (Some(path), _) => play(arguments, path.clone()),
        (None, _) => simulate(arguments),
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
    settings.suit.tcp = arguments.suit_tcp;
    settings.plate.address = match arguments.ground {
        None => arguments.plate,
        // The person stands on the other device; this port is unused.
        Some(_) => SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0),
    };
    let noise = settings.plate.noise;
    let stop = super::stop_on_signals()?;
    let person = Simulation::start(settings).with_context(|| format!("the plate at {}", arguments.plate))?;
    let device = arguments
        .ground
        .map(|kind| {
            let pace = Pace {
                start_ns: person.start_ns(),
                noise: Some(noise),
                seed: arguments.seed,
                ..Pace::default()
            };
            ground::start(kind, arguments.ground_address.as_deref(), arguments.two, person.load(), pace)
        })
        .transpose()?;
    match &device {
        None => println!("suit to {}, plate at {}; {ENDS}", arguments.suit, person.plate_address()),
        Some(device) => {
            println!("suit to {}; the device as the daemon must know it:\n", arguments.suit);
            println!("{}\n{ENDS}", device.config());
        }
    }
    let (started, mut acts) = (Instant::now(), 0);
    while !stop.load(Ordering::Relaxed)
        && arguments.seconds.is_none_or(|seconds| started.elapsed().as_secs_f64() < seconds)
    {
        // Repeat the sequence.
        if started.elapsed().as_secs_f64() > arguments.does.every_s() * acts as f64 {
            arguments.does.act(&person, acts)?;
            acts += 1;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    device.map_or(Ok(()), Running::stop)?;
    person.stop()?;
    Ok(Outcome::Done)
}

/// Positions for `--do corners`: forward and left, m, and turn, rad.
const CORNERS: [([f64; 2], f64); 7] = [
    ([0.12, 0.14], 0.0),
    ([0.12, -0.14], 0.0),
    ([-0.12, -0.14], 0.0),
    ([-0.12, 0.14], 0.0),
    ([0.0, 0.0], 0.0),
    ([0.0, 0.0], 1.4),
    ([0.0, 0.0], -1.4),
];
/// A walk is announced so long before, s: a person leans before the first step.
const AHEAD_S: f64 = 2.5;
/// What is lifted, kg: a medium load, two that are high as the worker holds them, and one that is too much for an arm held out.
const BOXES_KG: [f64; 4] = [6.0, 11.0, 14.0, 20.0];
/// Where weights are put, m.
const WEIGHTS_M: [[f64; 2]; 4] = [[0.2, 0.15], [0.2, -0.15], [-0.2, -0.15], [-0.2, 0.15]];

impl Does {
    /// How long each act takes, with getting there, s.
    fn every_s(self) -> f64 {
        match self {
            Does::Poses => POSE_S,
            Does::Lifts => 18.0,
            Does::Corners => 15.0,
            Does::Stomps => 25.0,
            Does::Weights => 8.0,
            Does::Away => 60.0,
            Does::Rod => 30.0,
        }
    }

    fn act(self, person: &SimulationHandle, acts: usize) -> anyhow::Result<()> {
        match self {
            Does::Poses => person.take_pose(acts % LIBRARY.len())?,
            Does::Lifts => person.lift_and_show(BOXES_KG[acts % BOXES_KG.len()]),
            Does::Corners => {
                let ([x, y], heading_rad) = CORNERS[acts % CORNERS.len()];
                person.go(AHEAD_S, StandingPosition { middle_m: [x, y].into(), heading_rad });
            }
            Does::Stomps => drop(person.stomp(6)),
            Does::Away => person.put_on_plates(OnPlates::Nothing),
            Does::Weights if acts.is_multiple_of(2) => person.put_on_plates(OnPlates::Nothing),
            Does::Weights => {
                let at_m = WEIGHTS_M[acts / 2 % WEIGHTS_M.len()];
                person.put_on_plates(OnPlates::Mass { mass_kg: 20.0, at_m });
            }
            Does::Rod if acts == 0 => person.put_on_plates(OnPlates::Nothing),
            Does::Rod => {
                person.put_on_plates(OnPlates::Rod { press_n: 300.0, lean_n: 60.0, at_m: [0.1, 0.05] });
            }
        }
        Ok(())
    }
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
    let stop = super::stop_on_signals()?;
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
