//! `equipoise plan`: where a work piece relieves the worker.

mod picture;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_config::Config;
use equipoise_core::exposure::Exposure;
use equipoise_core::handover::search::{REGION_M, places};
use equipoise_core::handover::{Body, FootPlacement, Infeasible, Part, Prediction, predict};
use equipoise_core::message::{State, Validity};
use equipoise_daemon::profile::{Profile, unix_s};
use equipoise_daemon::run::ConfigArgument;
use equipoise_files::atomic_file::write_atomically;
use equipoise_station::state_directory::StateDirectory;
use equipoise_station::status;
use nalgebra::Vector3;
use serde_json::{Value, json};

use super::Outcome;
use crate::client;

/// Find the place of a work piece at which it relieves the worker
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise plan handover --config station.toml --mass 6")]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, clap::Subcommand)]
enum What {
    Handover(HandoverArguments),
}

/// Predict the overload of a part that is handed over, over the places in front of an identified worker
///
/// Places are of the middle between the hands, from the middle between the ankles on the floor: forward, to the left, up.
/// The overload is that of the joint closest to its limit, in percent of the limit, with 1 sigma: the posture is predicted,
/// too. Fatigue of an unfinished shift reduces the limits. Without --live the worker stands at the station's origin and faces
/// X; `position_m` of a plan is in the station's world.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise plan handover --config station.toml --mass 6\n  equipoise plan handover --config \
                  station.toml --subject anon-1 --mass 6 --now 0.5,0,0.8 --live --out plan.json\n  equipoise plan handover --config station.toml \
                  --mass 6 --csv map.csv --picture map.svg"
)]
struct HandoverArguments {
    #[command(flatten)]
    config: ConfigArgument,
    /// Pseudonymous id of a stored profile; by default that of the configuration
    #[arg(long, value_name = "ID")]
    subject: Option<String>,
    /// Mass of the part, kg
    #[arg(long, value_name = "KG", value_parser = mass)]
    mass: f64,
    /// Difeet between the hands on the part, m
    #[arg(long, value_name = "M", default_value_t = 0.35, value_parser = width)]
    width: f64,
    /// Where the part is handed over now, m
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    now: Option<Vector3<f64>>,
    /// Plan for the feet and the fatigue of the worker who stands at the running station now
    #[arg(long)]
    live: bool,
    /// Write the best place as a plan for a cobot's controller, JSON, replaced at once
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the plan as JSON, with the whole map
    #[arg(long)]
    json: bool,
    /// Write the map as CSV
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Draw the map seen from the worker's right, as SVG
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

fn mass(text: &str) -> Result<f64, String> {
    let kg = text.parse().unwrap_or(f64::NAN);
    if (0.1..=50.0).contains(&kg) { Ok(kg) } else { Err("give a mass from 0.1 to 50 kg".to_owned()) }
}

fn width(text: &str) -> Result<f64, String> {
    let metres = text.parse().unwrap_or(f64::NAN);
    if (0.0..=1.0).contains(&metres) { Ok(metres) } else { Err("give a difeet from 0 to 1 m".to_owned()) }
}

fn place(text: &str) -> Result<Vector3<f64>, String> {
    let metres: Vec<f64> = text.split(',').map(|part| part.trim().parse().unwrap_or(f64::NAN)).collect();
    match metres[..] {
        [x, y, z] if metres.iter().all(|metres| metres.abs() <= 3.0) => Ok(Vector3::new(x, y, z)),
        _ => Err("give three numbers of metres, for example 0.5,0,0.8".to_owned()),
    }
}

/// One place of the map.
struct Spot {
    /// From the middle between the ankles on the floor: forward, to the left, up, m.
    at_m: Vector3<f64>,
    /// In the station's world, m.
    position_m: Vector3<f64>,
    predicted: Result<Prediction, Infeasible>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let What::Handover(arguments) = &arguments.what;
    let config = Config::read(&arguments.config.config)?;
    let id = arguments.subject.as_ref().unwrap_or(&config.subject.id);
    let (mut body, height_m) = body_of(&config, id)?;
    let mut feet = FootPlacement::natural(height_m);
    if arguments.live {
        let state = standing_worker(&config.station, id)?;
        (feet, body.fatigue) = (FootPlacement::of_segments(&state.segment_origin_m), state.fatigue);
    }
    let part = Part { mass_kg: arguments.mass, mass_sigma_kg: 0.0, width_m: arguments.width };
    let spot = |at_m: Vector3<f64>| {
        let position_m = feet.world_m(at_m, height_m);
        Spot { at_m, position_m, predicted: predict(&body, &feet, &part, position_m) }
    };
    let map: Vec<Spot> = places(REGION_M).map(spot).collect();
    let Some(best) = best_of(&map) else {
        let [forward, left, up] = REGION_M.map(|[low, high]| format!("{low} to {high} m"));
        bail!(
            "{id} can hold {} kg nowhere from {forward} forward, {left} to the left, {up} above the floor: reduce --mass or \
             --width",
            arguments.mass
        );
    };
    let now = arguments.now.map(spot);
    if let Some(path) = &arguments.csv {
        write(path, &csv(&map))?;
    }
    if let Some(path) = &arguments.picture {
        write(path, &picture::svg(&map, best, arguments.mass, id))?;
    }
    if let Some(path) = &arguments.out {
        write(path, &plan_of(best, id, arguments.mass).to_string())?;
    }
    if arguments.json {
        let map: Vec<Value> = map.iter().map(json_of).collect();
        let mut plan = plan_of(best, id, arguments.mass);
        plan["now"] = now.as_ref().map_or(Value::Null, json_of);
        plan["map"] = map.into();
        println!("{plan}");
        return Ok(Outcome::Done);
    }
    println!("best  {}", sentence(best));
    if let Some(now) = &now {
        println!("now   {}", sentence(now));
        if let (Ok(best), Ok(now)) = (&best.predicted, &now.predicted) {
            println!(
                "gain  {:.0} % of the limit",
                100.0 * (now.worst_limit_ratio() - best.worst_limit_ratio())
            );
        }
    }
    for path in [&arguments.out, &arguments.csv, &arguments.picture].into_iter().flatten() {
        println!("{}: written", path.display());
    }
    Ok(Outcome::Done)
}

/// The newest state of a running station that measures this subject, with valid segment positions.
fn standing_worker(station: &str, id: &str) -> anyhow::Result<State> {
    if let Some(running) = status::read(station)
        && running.subject != id
    {
        bail!(
            "{id} is not the subject at the station, {}: run `equipoise subject load {id}`",
            running.subject
        );
    }
    let state = client::newest_state(&client::join(station, "plan")?)?;
    let missing = Validity::SUIT_STALE
        .and(Validity::SUIT_IMPLAUSIBLE)
        .and(Validity::POSITION_UNKNOWN)
        .and(Validity::FEET_OFF_PLATE);
    if state.validity().any_of(missing) {
        let names: Vec<&str> = state.validity().names().collect();
        bail!(
            "the position of the worker's feet is not available: {}; see `equipoise status`, or plan without --live",
            names.join(", ")
        );
    }
    Ok(state)
}

/// The identified body of a stored subject, and its stature, m.
fn body_of(config: &Config, id: &str) -> anyhow::Result<(Body, f64)> {
    let path = StateDirectory::of_station(&config.station)?.profile(id);
    let profile = Profile::read(&path)?
        .with_context(|| format!("there is no profile {id}; `equipoise subject list` shows them"))?;
    if !profile.identified {
        bail!("{id} is not identified yet: {} poses; see `equipoise identify`", profile.poses_used);
    }
    if profile.mass_kg <= 0.0 {
        bail!("the mass of {id} is not known; let the plate weigh it, or set subject.mass_kg");
    }
    let mut config = config.clone();
    if let Some(build) = profile.build() {
        (config.subject.height_m, config.subject.sex) = (build.height_m, build.sex);
    }
    let settings = config.settings();
    let worker = profile
        .worker(&settings)
        .map_err(|reason| anyhow::anyhow!("the profile {id} is not used: {reason}"))?;
    let mut exposure = bytemuck::zeroed_box::<Exposure>();
    if let Ok(shift) = profile.shift(unix_s()) {
        exposure.resume(&shift);
    }
    Ok((worker.handover_body(&settings, exposure.fatigue.share), config.subject.height_m))
}

/// The place with the smallest overload.
fn best_of(map: &[Spot]) -> Option<&Spot> {
    let feasible =
        map.iter().filter_map(|spot| Some((spot, spot.predicted.as_ref().ok()?.worst_limit_ratio())));
    feasible.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(spot, _)| spot)
}

fn sentence(spot: &Spot) -> String {
    let [x, y, z] = spot.at_m.into();
    let at = format!("{x:.2} m forward, {y:.2} m to the left, {z:.2} m up");
    match &spot.predicted {
        Ok(predicted) => format!(
            "{at}: {:.0} ± {:.0} % of the limit of {}",
            100.0 * predicted.worst_limit_ratio(),
            100.0 * predicted.worst_sigma,
            predicted.worst.name()
        ),
        Err(why) => format!("{at}: {}", why.name()),
    }
}

/// The best place as a plan for a controller of a cobot.
fn plan_of(best: &Spot, subject: &str, mass_kg: f64) -> Value {
    let position_m: [f64; 3] = best.position_m.into();
    let predicted = best.predicted.as_ref().ok();
    json!({
        "subject": subject,
        "mass_kg": mass_kg,
        "position_m": position_m,
        "worst_limit_ratio": predicted.map(Prediction::worst_limit_ratio),
        "worst_limit_ratio_sigma": predicted.map(|predicted| predicted.worst_sigma),
        "worst_joint": predicted.map(|predicted| predicted.worst.name()),
    })
}

/// A place of the map. No key of a plan is in it, so that a simple reader of a plan finds only the best place.
fn json_of(spot: &Spot) -> Value {
    let place_m: [f64; 3] = spot.at_m.into();
    match &spot.predicted {
        Ok(predicted) => json!({
            "place_m": place_m,
            "limit_ratio": predicted.worst_limit_ratio(),
            "limit_ratio_sigma": predicted.worst_sigma,
            "joint": predicted.worst.name(),
        }),
        Err(why) => json!({ "place_m": place_m, "infeasible": why.name() }),
    }
}

fn csv(map: &[Spot]) -> String {
    let mut text = "forward_m,left_m,up_m,limit_ratio,limit_ratio_sigma,joint\n".to_owned();
    for Spot { at_m, predicted, .. } in map {
        let values = match predicted {
            Ok(predicted) => format!(
                "{:.4},{:.4},{}",
                predicted.worst_limit_ratio(),
                predicted.worst_sigma,
                predicted.worst.name()
            ),
            Err(why) => format!(",,{}", why.name()),
        };
        let _ = writeln!(text, "{:.2},{:.2},{:.2},{values}", at_m.x, at_m.y, at_m.z);
    }
    text
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    write_atomically(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
}
