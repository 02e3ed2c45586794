//! `equipoise plan`: where a work piece relieves the worker.

mod live;
mod picture;

use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_config::Config;
use equipoise_core::body::JOINTS;
use equipoise_core::handover::experience::{Experience, LimitRatio};
use equipoise_core::handover::search::{PlacePrediction, Planning, Predicted, REGION_M, places};
use equipoise_core::handover::{Body, FootPlacement, MASS_KG, PLACE_MAX_M, Part, WIDTH_M};
use equipoise_daemon::profile::{Profile, unix_s};
use equipoise_daemon::run::ConfigArgument;
use equipoise_files::atomic_file::write_atomically;
use equipoise_station::state_directory::StateDirectory;
use nalgebra::Vector3;
use serde_json::{Value, json};

use super::Outcome;

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
/// too, and corrected by the handovers measured before. Fatigue of an unfinished shift reduces the limits. Without --live the
/// worker stands at the station's origin and faces X; `position_m` of a plan is in the station's world.
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
    /// Distance between the hands on the part, m
    #[arg(long, value_name = "M", default_value_t = 0.35, value_parser = width)]
    width: f64,
    /// Where the part is handed over now, m
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    now: Option<Vector3<f64>>,
    /// Let the running daemon plan for the feet and the fatigue of the worker who stands at the station now; without a map
    #[arg(long, conflicts_with_all = ["csv", "picture"])]
    live: bool,
    /// Write the best place as a plan for a cobot's controller, JSON, replaced at once
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the plan as JSON, with the whole map unless --live is given
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
    number_in(&MASS_KG, text).ok_or_else(|| "give a mass from 0.1 to 50 kg".to_owned())
}

fn width(text: &str) -> Result<f64, String> {
    number_in(&WIDTH_M, text).ok_or_else(|| "give a distance from 0 to 1 m".to_owned())
}

fn number_in(range: &RangeInclusive<f64>, text: &str) -> Option<f64> {
    text.parse().ok().filter(|number| range.contains(number))
}

fn place(text: &str) -> Result<Vector3<f64>, String> {
    let metres: Vec<f64> = text.split(',').map(|part| part.trim().parse().unwrap_or(f64::NAN)).collect();
    match metres[..] {
        [x, y, z] if metres.iter().all(|metres| metres.abs() <= PLACE_MAX_M) => Ok(Vector3::new(x, y, z)),
        _ => Err("give three numbers of metres, for example 0.5,0,0.8".to_owned()),
    }
}

/// The best place, the current one, and what they stand on.
struct Plan {
    best: PlacePrediction,
    /// Heading of the feet: angle from the station's X axis about the vertical, rad; 0 without a running daemon.
    feet_heading_rad: f64,
    /// The current place, relative to the feet, m.
    now: Option<(Vector3<f64>, Predicted)>,
    /// Number of measured handovers.
    handovers: usize,
    /// All places; empty for a plan of the daemon.
    map: Vec<PlacePrediction>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let What::Handover(arguments) = &arguments.what;
    let config = Config::read(&arguments.config.config)?;
    let id = arguments.subject.as_ref().unwrap_or(&config.subject.id);
    let plan = if arguments.live {
        live::plan(&config.station, id, arguments)?
    } else {
        stored(&config, id, arguments)?
    };
    let Plan { best, now, map, .. } = &plan;
    if let Some(path) = &arguments.csv {
        write(path, &csv(map))?;
    }
    if let Some(path) = &arguments.picture {
        write(path, &picture::svg(map, best, arguments.mass, id))?;
    }
    let mut json = json_of_plan(&plan, id, arguments.mass);
    if let Some(path) = &arguments.out {
        write(path, &json.to_string())?;
    }
    if arguments.json {
        json["now"] = now.map_or(Value::Null, |(place_m, predicted)| json_of(place_m, None, predicted));
        json["map"] =
            map.iter().map(|place| json_of(place.place_m, place.slope_rad, place.predicted)).collect();
        println!("{json}");
        return Ok(Outcome::Done);
    }
    println!("best  {}", sentence(best.place_m, best.slope_rad, best.predicted));
    if let Some((place_m, predicted)) = *now {
        println!("now   {}", sentence(place_m, None, predicted));
        if let (Ok((_, best)), Ok((_, now))) = (best.predicted, predicted) {
            println!("gain  {:.0} % of the limit", 100.0 * (now.value - best.value));
        }
    }
    println!("corrected by {} measured handovers", plan.handovers);
    for path in [&arguments.out, &arguments.csv, &arguments.picture].into_iter().flatten() {
        println!("{}: written", path.display());
    }
    Ok(Outcome::Done)
}

/// The plan from the stored profile, for a worker at the station's origin.
fn stored(config: &Config, id: &str, arguments: &HandoverArguments) -> anyhow::Result<Plan> {
    let Stored { body, height_m, experience } = stored_subject(config, id)?;
    let feet = FootPlacement::natural(height_m);
    let part =
        Part { mass_kg: arguments.mass, mass_sigma_kg: 0.0, width_m: arguments.width, slope_rad: None };
    let planning = Planning { body: &body, height_m, feet: &feet, part: &part, experience: &experience };
    let map: Vec<PlacePrediction> = places(REGION_M).map(|place_m| planning.at_best_slope(place_m)).collect();
    let Some(best) = PlacePrediction::lowest(map.iter().copied()) else {
        bail!(infeasible(id, arguments.mass))
    };
    let now = arguments.now.map(|place_m| (place_m, planning.at(place_m, None).predicted));
    Ok(Plan { best, feet_heading_rad: 0.0, now, handovers: experience.count(), map })
}

fn mass_unknown(id: &str) -> String {
    format!("the mass of {id} is not known; let the plate weigh it, or set subject.mass_kg")
}

fn infeasible(id: &str, mass_kg: f64) -> String {
    let [forward, left, up] = REGION_M.map(|[low, high]| format!("{low} to {high} m"));
    format!(
        "{id} can hold {mass_kg} kg nowhere from {forward} forward, {left} to the left, {up} above the floor: reduce --mass \
         or --width"
    )
}

/// A stored subject as plans need it.
struct Stored {
    body: Body,
    /// Stature, m.
    height_m: f64,
    experience: Experience,
}

fn stored_subject(config: &Config, id: &str) -> anyhow::Result<Stored> {
    let path = StateDirectory::of_station(&config.station)?.profile(id);
    let profile = Profile::read(&path)?
        .with_context(|| format!("there is no profile {id}; `equipoise subject list` shows them"))?;
    if !profile.identified {
        bail!("{id} is not identified yet: {} poses; see `equipoise identify`", profile.poses_used);
    }
    if profile.mass_kg <= 0.0 {
        bail!(mass_unknown(id));
    }
    let is_configured = config.subject.id == id;
    let config = if is_configured { config.clone() } else { config.with_subject(id, Some(profile.build())) };
    let settings = config.settings();
    let worker = profile
        .worker(&settings)
        .map_err(|reason| anyhow::anyhow!("the profile {id} is not used: {reason}"))?;
    let fatigue = profile.shift(unix_s()).map_or([0.0; JOINTS], |(shift, ..)| shift.fatigue);
    Ok(Stored {
        body: worker.handover_body(&settings, fatigue),
        height_m: config.subject.height_m,
        experience: profile.experience(),
    })
}

fn sentence(place_m: Vector3<f64>, slope_rad: Option<f64>, predicted: Predicted) -> String {
    let [x, y, z] = place_m.into();
    let mut at = format!("{x:.2} m forward, {y:.2} m to the left, {z:.2} m up");
    if let Some(slope_rad) = slope_rad {
        let _ = write!(at, ", handles sloped by {:.0}°", slope_rad.to_degrees());
    }
    match predicted {
        Ok((worst, LimitRatio { value, sigma })) => {
            format!("{at}: {:.0} ± {:.0} % of the limit of {}", 100.0 * value, 100.0 * sigma, worst.name())
        }
        Err(why) => format!("{at}: {}", why.name()),
    }
}

/// The best place as a plan for a controller of a cobot.
fn json_of_plan(plan: &Plan, subject: &str, mass_kg: f64) -> Value {
    let Plan { best, feet_heading_rad, handovers, .. } = plan;
    let position_m: [f64; 3] = best.position_m.into();
    let predicted = best.predicted.ok();
    json!({
        "subject": subject,
        "mass_kg": mass_kg,
        "position_m": position_m,
        "slope_rad": best.slope_rad,
        "feet_heading_rad": feet_heading_rad,
        "worst_limit_ratio": predicted.map(|(_, ratio)| ratio.value),
        "worst_limit_ratio_sigma": predicted.map(|(_, ratio)| ratio.sigma),
        "worst_joint": predicted.map(|(worst, _)| worst.name()),
        "handovers": handovers,
    })
}

/// A place of the map. No key of a plan is in it, so that a simple reader of a plan finds only the best place.
fn json_of(place_m: Vector3<f64>, slope_rad: Option<f64>, predicted: Predicted) -> Value {
    let place_m: [f64; 3] = place_m.into();
    match predicted {
        Ok((worst, ratio)) => json!({
            "place_m": place_m,
            "handle_slope_rad": slope_rad,
            "limit_ratio": ratio.value,
            "limit_ratio_sigma": ratio.sigma,
            "joint": worst.name(),
        }),
        Err(why) => json!({ "place_m": place_m, "infeasible": why.name() }),
    }
}

fn csv(map: &[PlacePrediction]) -> String {
    let mut text = "forward_m,left_m,up_m,slope_rad,limit_ratio,limit_ratio_sigma,joint\n".to_owned();
    for PlacePrediction { place_m, slope_rad, predicted, .. } in map {
        let values = match predicted {
            Ok((worst, ratio)) => format!("{:.4},{:.4},{}", ratio.value, ratio.sigma, worst.name()),
            Err(why) => format!(",,{}", why.name()),
        };
        let _ = writeln!(
            text,
            "{:.2},{:.2},{:.2},{:.4},{values}",
            place_m.x,
            place_m.y,
            place_m.z,
            slope_rad.unwrap_or_default()
        );
    }
    text
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    write_atomically(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
}
