//! `equipoise verify`: compares the plate's measurement with a known mass, or with a rod.

mod load;
mod results;

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::bail;
use equipoise_adapters::calibration::verify::rod::tip;
use equipoise_adapters::calibration::verify::{Block, Blocks, Step, Verification, VerifySettings};
use equipoise_core::GRAVITY_M_PER_S2;
use equipoise_core::message::GroundSample;

use super::{Outcome, StationArgument};
use crate::client;
use crate::client::StreamTimeout;
use results::{MassResult, Rod};

/// The empty plate before a rod is put on it, blocks of 0.1 s.
const ZERO_BLOCKS: usize = 20;

/// Weigh a known mass: how far the plate is off, at one place or at several
///
/// Leave the plate empty at first: its zero is measured, so a tare is not needed. With --places the mass is lifted off and
/// put down again elsewhere; with --at also the scale of the moments, the turn and the origin of the plate are checked.
/// With --rod, press a pointed rod on one point of the plate and lean it all around: this measures the height of the
/// surface above the sensor.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise verify --mass 20.0\n  equipoise verify --mass 20.0 --at 0.2,0.15 --at 0.2,-0.15 --at \
                  -0.2,-0.15 --at -0.2,0.15\n  equipoise verify --rod\n  equipoise verify load --mass 10 --at 0.35,0 --at 0.5,0\n\nExit code 1: the plate is off by more than \
                  --tolerance, or its error could not be determined."
)]
#[command(group = clap::ArgGroup::new("what").required(true), subcommand_negates_reqs = true)]
pub(super) struct Arguments {
    #[command(subcommand)]
    target: Option<Target>,
    /// The mass, kg
    #[arg(long = "mass", value_name = "KG", value_parser = super::seconds, group = "what")]
    mass_kg: Option<f64>,
    /// A pointed rod instead of a mass
    #[arg(long, group = "what", conflicts_with_all = ["places", "at"])]
    rod: bool,
    #[command(flatten)]
    station: StationArgument,
    /// How long to measure at each place, or the rod
    #[arg(long = "for", value_name = "SECONDS", value_parser = super::seconds)]
    seconds: Option<f64>,
    /// At how many places to put it
    #[arg(long, value_name = "COUNT", default_value_t = 1, conflicts_with = "at")]
    places: usize,
    /// Where its centre is put, m from the plate's origin along its own x axis and to the left of it; once for each place
    #[arg(long, value_name = "X,Y", value_parser = parse_point, allow_hyphen_values = true)]
    at: Vec<[f64; 2]>,
    /// The plate may be off by so many percent of the mass
    #[arg(long, value_name = "PERCENT", value_parser = super::seconds, default_value = "1.0")]
    tolerance: f64,
    /// Gravity there, m/s²
    #[arg(long, value_name = "M_PER_S2", value_parser = super::seconds, default_value_t = GRAVITY_M_PER_S2)]
    gravity: f64,
    /// End after so many seconds
    #[arg(long = "within", value_name = "SECONDS", value_parser = super::seconds, default_value = "600")]
    within: f64,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// Checks other than that of the plate alone.
#[derive(Debug, clap::Subcommand)]
enum Target {
    Load(load::Arguments),
}

/// `0.2,-0.15`
fn parse_point(text: &str) -> Result<[f64; 2], String> {
    let (x, y) = text.split_once(',').ok_or("give two numbers with a comma between them")?;
    let metres = |text: &str| text.trim().parse::<f64>().ok().filter(|metres| metres.abs() < 2.0);
    match (metres(x), metres(y)) {
        (Some(x), Some(y)) => Ok([x, y]),
        _ => Err("metres are expected, below 2".to_owned()),
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match (&arguments.target, arguments.mass_kg) {
        (Some(Target::Load(arguments)), _) => load::run(arguments),
        (None, Some(mass_kg)) => weigh(arguments, mass_kg),
        (None, None) => lean(arguments),
    }
}

/// The ground's samples of a station, one after the other.
struct PlateReader {
    station: String,
    within: f64,
}

impl PlateReader {
    fn of(arguments: &Arguments) -> PlateReader {
        PlateReader { station: arguments.station.station.clone(), within: arguments.within }
    }

    /// Shows each sample until it is enough; `false` if time was over before.
    fn read_samples(
        &self,
        mut ingest: impl FnMut(&GroundSample) -> anyhow::Result<bool>,
    ) -> anyhow::Result<bool> {
        let stop = super::stop_on_signals()?;
        let bus = client::join(&self.station, "verify")?;
        let mut samples = bus.subscriber::<GroundSample>(1024)?;
        // Discard samples from before the start.
        let _old = samples.latest()?;
        let mut timeout = StreamTimeout::new("the ground", &self.station);
        let started = Instant::now();
        while started.elapsed().as_secs_f64() < self.within {
            if stop.load(Ordering::Relaxed) {
                bail!("stopped");
            }
            while let Some(sample) = samples.receive()? {
                timeout.reset();
                if ingest(&sample)? {
                    return Ok(true);
                }
            }
            timeout.check()?;
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(false)
    }
}

fn weigh(arguments: &Arguments, mass_kg: f64) -> anyhow::Result<Outcome> {
    let places = if arguments.at.is_empty() { arguments.places } else { arguments.at.len() };
    let settings = VerifySettings {
        mass_kg,
        gravity_m_per_s2: arguments.gravity,
        seconds: arguments.seconds.unwrap_or(5.0),
        places,
    };
    // Read before the measurement, because a later error would discard its result.
    let has_positions = !arguments.at.is_empty();
    let frame = has_positions.then(|| results::frame_of(&arguments.station.station)).transpose()?;
    let mut verification = Verification::new(settings);
    let (mut zero_n, mut zero_drift_n) = (0.0, None);
    eprintln!("leave the plate empty …");
    let prompt = |number: usize| {
        let place =
            arguments.at.get(number).map_or("on the plate".to_owned(), |[x, y]| format!("at {x}, {y} m"));
        eprintln!("{} of {places}: put the {mass_kg} kg {place} and let go", number + 1);
    };
    let done = PlateReader::of(arguments).read_samples(|sample| {
        match verification.take(sample)? {
            Some(Step::Zeroed(shows_n)) => {
                zero_n = shows_n;
                prompt(0);
            }
            Some(Step::Settled) => eprintln!("  measuring …"),
            Some(Step::Disturbed) => eprintln!("  it was touched; once more …"),
            Some(Step::Placed(placed)) => {
                eprintln!("  {:.3} kg", placed.mass_kg);
                if !verification.is_done() {
                    eprintln!("  lift it off");
                }
            }
            Some(Step::Lifted(drift_n)) => {
                zero_drift_n = Some(drift_n);
                prompt(verification.placed().len());
            }
            None => {}
        }
        Ok(verification.is_done())
    })?;
    if !done {
        bail!("time is over: {} of {places} places were measured", verification.placed().len());
    }
    let result = MassResult {
        mass_kg,
        tolerance_percent: arguments.tolerance,
        placed: verification.placed().to_vec(),
        zero_n,
        zero_drift_n,
        geometry: frame
            .as_ref()
            .and_then(|frame| results::geometry_of(verification.placed(), &arguments.at, frame)),
    };
    report(arguments, &result)
}

/// Displays the result; an error above the tolerance is the outcome.
fn report(arguments: &Arguments, result: &MassResult) -> anyhow::Result<Outcome> {
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&result.json())?);
    } else {
        print!("{}", result.text());
    }
    let worst = result.worst_percent();
    if worst.abs() > arguments.tolerance {
        bail!(
            "the plate is off by {worst:+.2} %, more than {} %: check its scale (counts or units of [ground]), its range, and \
             whether something touches it",
            arguments.tolerance
        );
    }
    Ok(Outcome::Done)
}

fn lean(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let count = (arguments.seconds.unwrap_or(15.0) * 10.0).ceil() as usize;
    let (mut collector, mut zeros, mut blocks) = (Blocks::default(), Vec::new(), Vec::new());
    let mut configured_z_m = 0.0;
    eprintln!("leave the plate empty …");
    let done = PlateReader::of(arguments).read_samples(|sample| {
        if sample.device_status != 0 {
            bail!("the plate reports a fault, status {:#x}", sample.device_status);
        }
        configured_z_m = sample.surface_z_m;
        let Some(block) = collector.take(sample) else { return Ok(false) };
        if zeros.len() < ZERO_BLOCKS {
            zeros.push(block);
            if zeros.len() == ZERO_BLOCKS {
                eprintln!(
                    "press the rod's tip on one point of the plate, and lean it all around, tip in place"
                );
            }
            return Ok(false);
        }
        let block = block.less(&mean(&zeros));
        if block.force_n[2] >= equipoise_adapters::calibration::verify::rod::PRESS_MIN_N {
            blocks.push(block);
        }
        Ok(blocks.len() >= count)
    })?;
    let rod = Rod { tip: tip(&blocks)?, configured_z_m };
    if !done {
        eprintln!("time is over; this is of {:.1} s", blocks.len() as f64 / 10.0);
    }
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&rod.json())?);
    } else {
        print!("{}", rod.text());
    }
    Ok(Outcome::Done)
}

fn mean(blocks: &[Block]) -> Block {
    let count = blocks.len().max(1) as f64;
    let mut sum = Block::default();
    for block in blocks {
        for axis in 0..3 {
            sum.force_n[axis] += block.force_n[axis] / count;
            sum.moment_nm[axis] += block.moment_nm[axis] / count;
        }
    }
    sum
}
