//! `equipoise register`: estimates the pose of the plate in the suit world from positions at which the worker stood still.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::bail;
use equipoise_adapters::calibration::register::holds::{Holds, Progress};
use equipoise_adapters::calibration::register::{Correction, HOLDS_MIN, Hold, register};
use equipoise_adapters::ground::GroundFrame;
use equipoise_config::Config;
use equipoise_core::message::{State, SuitSample};

use super::{Outcome, StationArgument};
use crate::calibration::config_file::{self, Calibrated, Change};
use crate::calibration::standing::Standing;
use crate::client;
use crate::client::StreamTimeout;

/// Positions at which the worker stands; the last two separate an offset of the plate from a deviation of the body from
/// the table.
const POSITIONS: [&str; 7] = [
    "near the front left corner",
    "near the front right corner",
    "near the back right corner",
    "near the back left corner",
    "in the middle",
    "in the middle, turned to the left by a quarter",
    "in the middle, turned to the right by a quarter",
];

/// Find where the plate stands in the suit's world: the worker stands still at its corners
///
/// Tare first. Then the worker stands with both feet at one place after the other, still for two seconds at each, all of
/// them looking the same way but the last two. From where the plate feels the worker and where the suit sees the body
/// follow the turn and the place of the plate.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise register --write /etc/equipoise/station-1.toml\n\nRestart the daemon to apply the \
                  result; then tare, and identify the worker again: the previous identification is valid for the \
                  previous frame only."
)]
pub(super) struct Arguments {
    #[command(flatten)]
    station: StationArgument,
    /// At how many places to stand, 3 at least; without the two turns of the last two the place is known less well
    #[arg(long, value_name = "COUNT", default_value_t = POSITIONS.len())]
    places: usize,
    /// End after so many seconds, with the places there are by then
    #[arg(long = "within", value_name = "SECONDS", value_parser = super::seconds, default_value = "300")]
    seconds: f64,
    /// Set `[ground.frame]` in this configuration file
    #[arg(long, value_name = "CONFIG")]
    write: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let config = client::active_configuration_of(&arguments.station.station)?;
    if config.ground.is_insoles() {
        bail!("insoles have no place of their own: there is nothing to register");
    }
    client::own_ground(&config, "[ground.frame]")?;
    if let Some(path) = &arguments.write {
        // Check the file before the worker walks to the places.
        config_file::check(path, &config, Calibrated::Frames)?;
    }
    if arguments.places < HOLDS_MIN {
        bail!("--places {}: {HOLDS_MIN} at least", arguments.places);
    }
    let holds = collect_holds(arguments, &config)?;
    let found = register(&holds)?;
    let frames = frames(&config, &found);
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&json(&holds, &found, &frames))?);
    } else {
        print(&holds, &found, &frames);
    }
    if let Some(path) = &arguments.write {
        let changes: Vec<Change> = frames.iter().flat_map(CorrectedFrame::changes).collect();
        config_file::write(path, &changes)?;
        eprintln!(
            "{}: written; restart the daemon and, if the ground's adapter is a process of its own, that too (systemd: \
             `systemctl restart equipoise equipoise-adapter@ground`), then `equipoise tare` and `equipoise identify reset`",
            path.display()
        );
    }
    Ok(Outcome::Done)
}

/// Follows the worker from place to place.
fn collect_holds(arguments: &Arguments, config: &Config) -> anyhow::Result<Vec<Hold>> {
    let stop = super::stop_on_signals()?;
    let station = &arguments.station.station;
    let bus = client::join(station, "register")?;
    let mut suits = bus.subscriber::<SuitSample>(128)?;
    let mut states = bus.subscriber::<State>(1024)?;
    let mut timeout = StreamTimeout::new("the daemon or the suit", station);
    let mut standing = Standing::new(config.subject.height_m, config.subject.sex.into());
    let mut holds = Holds::default();
    let (started, mut is_still) = (Instant::now(), false);
    prompt(0, arguments.places);
    while holds.completed().len() < arguments.places && started.elapsed().as_secs_f64() < arguments.seconds {
        if stop.load(Ordering::Relaxed) {
            bail!("stopped");
        }
        while let Some(sample) = suits.receive()? {
            standing.suit(&sample);
        }
        while let Some(state) = states.receive()? {
            let Some(sample) = standing.state(&state) else { continue };
            timeout.reset();
            match holds.ingest(sample) {
                Progress::Moving | Progress::AlreadyUsed => is_still = false,
                Progress::Holding { remaining_s } if !is_still && remaining_s < 1.5 => {
                    is_still = true;
                    eprintln!("  hold still …");
                }
                Progress::Holding { .. } => {}
                Progress::Completed(_) => {
                    is_still = false;
                    eprintln!("  got it");
                    prompt(holds.completed().len(), arguments.places);
                }
            }
        }
        timeout.check()?;
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(holds.completed().to_vec())
}

fn prompt(done: usize, places: usize) {
    if done < places {
        let place = POSITIONS.get(done).unwrap_or(&"anywhere else on the plate");
        eprintln!("{} of {places}: stand {place}, with both feet on the plate", done + 1);
    }
}

/// A frame that was in force, and as it is.
struct CorrectedFrame {
    table: &'static str,
    frame: GroundFrame,
    sigma_m: [f64; 2],
    sigma_rad: f64,
}

/// The frames of the station's plates; two that are used together are turned and shifted together.
fn frames(config: &Config, found: &Correction) -> Vec<CorrectedFrame> {
    let placed = |table: &'static str, before: GroundFrame| {
        let [x, y, _] = before.origin_m;
        let (_, sigma_m) = found.point_m([x, y]);
        CorrectedFrame { table, frame: found.of_frame(&before), sigma_m, sigma_rad: found.yaw_sigma_rad() }
    };
    let mut frames = vec![placed("ground.frame", config.ground.settings().frame)];
    let plates = config.ground.second.iter().filter(|second| !second.is_insoles());
    frames.extend(plates.map(|second| placed("ground.second.frame", second.settings().frame)));
    frames
}

impl CorrectedFrame {
    fn changes(&self) -> Vec<Change> {
        let key = |name: &str| format!("{}.{name}", self.table);
        vec![
            (key("origin_m"), config_file::numbers(&self.frame.origin_m, 4)),
            (key("yaw_deg"), config_file::number(self.frame.yaw_rad.to_degrees(), 2)),
        ]
    }
}

fn print(holds: &[Hold], found: &Correction, frames: &[CorrectedFrame]) {
    println!("place         plate says m        suit says m   looks °   left over mm");
    for (index, (hold, [x, y])) in holds.iter().zip(&found.residuals_m).enumerate() {
        println!(
            "{:>5}    {:>8.3} {:>8.3}  {:>8.3} {:>8.3}  {:>8.0} {:>8.0} {:>5.0}",
            index + 1,
            hold.measured_m[0],
            hold.measured_m[1],
            hold.expected_m[0],
            hold.expected_m[1],
            hold.heading_rad.to_degrees(),
            1e3 * x,
            1e3 * y
        );
    }
    let [forward_m, left_m] = found.bias_m.map(|metres| metres + 0.0);
    let [forward_sigma_m, left_sigma_m] = found.bias_sigma_m();
    println!(
        "the places lie {:.0} mm from their middle; one place is known to {:.0} mm",
        1e3 * found.spread_m,
        1e3 * found.hold_sigma_m
    );
    println!(
        "the frame in force must be turned by {:.2} ± {:.2}° to the left",
        found.yaw_rad.to_degrees(),
        found.yaw_sigma_rad().to_degrees()
    );
    println!(
        "the body's centre lies {:.0} ± {:.0} mm forward and {:.0} ± {:.0} mm left of the table's",
        1e3 * forward_m,
        1e3 * forward_sigma_m,
        1e3 * left_m,
        1e3 * left_sigma_m
    );
    for CorrectedFrame { table, frame, sigma_m, sigma_rad } in frames {
        let [x, y, z] = frame.origin_m;
        println!("\n[{table}]");
        println!(
            "origin_m = [{x:.4}, {y:.4}, {z:.4}]   # ± {:.0}, {:.0} mm",
            1e3 * sigma_m[0],
            1e3 * sigma_m[1]
        );
        println!("yaw_deg = {:.2}   # ± {:.2}", frame.yaw_rad.to_degrees(), sigma_rad.to_degrees());
    }
}

fn json(holds: &[Hold], found: &Correction, frames: &[CorrectedFrame]) -> serde_json::Value {
    let places: Vec<_> = holds
        .iter()
        .zip(&found.residuals_m)
        .map(|(hold, left_m)| {
            serde_json::json!({
                "plate_m": hold.measured_m, "suit_m": hold.expected_m,
                "heading_deg": hold.heading_rad.to_degrees(), "left_over_m": left_m,
            })
        })
        .collect();
    let frames: serde_json::Map<String, serde_json::Value> = frames
        .iter()
        .map(|CorrectedFrame { table, frame, sigma_m, sigma_rad }| {
            let value = serde_json::json!({
                "origin_m": frame.origin_m, "origin_sigma_m": sigma_m,
                "yaw_deg": frame.yaw_rad.to_degrees(), "yaw_sigma_deg": sigma_rad.to_degrees(),
            });
            ((*table).to_owned(), value)
        })
        .collect();
    serde_json::json!({
        "places": places,
        "turned_deg": found.yaw_rad.to_degrees(), "turned_sigma_deg": found.yaw_sigma_rad().to_degrees(),
        "shift_m": found.shift_m, "bias_m": found.bias_m, "bias_sigma_m": found.bias_sigma_m(),
        "place_sigma_m": found.hold_sigma_m, "spread_m": found.spread_m, "frames": frames,
    })
}
