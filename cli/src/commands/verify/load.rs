//! `equipoise verify load`: published torques against those of a known mass in the hands.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, bail};
use equipoise_config::Config;
use equipoise_core::GRAVITY_M_PER_S2;
use equipoise_core::message::{Incident, State, Validity};
use equipoise_files::{Existing, write_regular};
use equipoise_station::state_directory::StateDirectory;
use equipoise_station::status::{self, Status};
use serde_json::{Value, json};

use crate::calibration::load_check::{Comparison, Event, GROUPS, LoadCheck, LoadCheckSettings, Trial};
use crate::client::{self, StreamTimeout};
use crate::commands::{Outcome, StationArgument, stop_on_signals};

/// The check fails beyond so many σ.
const SIGMAS_MAX: f64 = 3.0;
/// Interval at which the reasons of masked torques are printed.
const MASKED_INTERVAL: Duration = Duration::from_secs(10);

/// Compare published joint torques with those of a known mass in the hands
///
/// The worker stands on the plate, identified, and holds the mass with both hands above one mark on the floor after the
/// other. Mass, marks and the suit's joints give the expected moments of L5/S1, shoulders, elbows and hips.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise verify load --mass 10 --at 0.35,0 --at 0.50,0 --at 0.65,0\n\nEach result is appended to \
                  SUBJECT.load-checks.jsonl, next to the subject's profile, if that is saved and the subject did not change. Exit code 1: an error exceeds 3 sigma."
)]
pub(super) struct Arguments {
    /// The mass, kg
    #[arg(long = "mass", value_name = "KG", value_parser = crate::commands::seconds)]
    mass_kg: f64,
    /// A mark on the floor, below the mass, m in the station's world; once for each trial
    #[arg(long, value_name = "X,Y", value_parser = super::parse_point, allow_hyphen_values = true, required = true)]
    at: Vec<[f64; 2]>,
    #[command(flatten)]
    station: StationArgument,
    /// How long to measure each trial
    #[arg(long = "for", value_name = "SECONDS", value_parser = crate::commands::seconds, default_value = "5")]
    seconds: f64,
    /// Gravity there, m/s²
    #[arg(long, value_name = "M_PER_S2", value_parser = crate::commands::seconds, default_value_t = GRAVITY_M_PER_S2)]
    gravity: f64,
    /// End after so many seconds
    #[arg(long = "within", value_name = "SECONDS", value_parser = crate::commands::seconds, default_value = "600")]
    within: f64,
    /// As JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let station = &arguments.station.station;
    let Some(before) = status::read(station) else {
        bail!("no daemon runs on station {station}; start one with `equipoise run --config FILE`");
    };
    let trials = guide(arguments)?;
    let result = json(arguments, &trials);
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&result)?);
    } else {
        print!("{}", text(arguments.mass_kg, &trials));
    }
    match results_file(&before, status::read(station).as_ref())? {
        Ok(file) => {
            append(&file, &result)
                .with_context(|| format!("{}: the result is not stored", file.display()))?;
        }
        Err(reason) => eprintln!("the result is not stored: {reason}"),
    }
    let worst = worst_sigmas(arguments.mass_kg, &trials);
    if worst > SIGMAS_MAX {
        bail!(
            "an error is {worst:.1} sigma: check the plate (`equipoise verify --mass`), its place (`equipoise register`), then \
             identify again (`equipoise identify reset`)"
        );
    }
    Ok(Outcome::Done)
}

/// The file of the measured subject, or why the result must not be stored. Data of a body are stored only if they are
/// certainly of that subject, and only while its profile is. `before` and `after` are the daemon's status before and
/// after the measurement.
fn results_file(before: &Status, after: Option<&Status>) -> anyhow::Result<Result<PathBuf, String>> {
    let Some(after) = after else { return Ok(Err("the daemon has ended".to_owned())) };
    let subject = &after.subject;
    if subject.is_empty() {
        return Ok(Err(
            "the worker has no name; load a subject first (`equipoise subject load ID`)".to_owned()
        ));
    }
    if before.subject != *subject {
        let was = if before.subject.is_empty() { "an unnamed worker" } else { &before.subject };
        return Ok(Err(format!("{was} was in use at the start, and {subject} at the end")));
    }
    let config = Config::parse(&after.config_toml, "the daemon's configuration")?;
    if !config.subject.save_profile {
        return Ok(Err("subject.save_profile is false in the configuration".to_owned()));
    }
    if let Some(reason) = after.incidents.get(Incident::NotSaved.name()) {
        return Ok(Err(reason.clone()));
    }
    let directory = match StateDirectory::of_daemon(after) {
        Some(directory) => directory,
        None => StateDirectory::of_environment()?,
    };
    // A subject that was just deleted is in the status for a second.
    if !directory.profile(subject).exists() {
        return Ok(Err(format!("there is no profile {subject}")));
    }
    Ok(Ok(directory.load_checks(subject)))
}

/// Follows the worker from mark to mark.
fn guide(arguments: &Arguments) -> anyhow::Result<Vec<Trial>> {
    let stop = stop_on_signals()?;
    let station = &arguments.station.station;
    let bus = client::join(station, "verify")?;
    if client::newest_state(&bus)?.converged == 0 {
        bail!("no worker is identified on station {station}: run `equipoise identify start` first");
    }
    let mut states = bus.subscriber::<State>(1024)?;
    let mut timeout = StreamTimeout::new("the daemon", station);
    let mut check = LoadCheck::new(LoadCheckSettings {
        mass_kg: arguments.mass_kg,
        gravity_m_per_s2: arguments.gravity,
        seconds: arguments.seconds,
        at_m: arguments.at.clone(),
    });
    let mut masked = Masked { since: Instant::now() };
    eprintln!("stand on the plate with empty hands …");
    let started = Instant::now();
    while !check.is_done() {
        if stop.load(Ordering::Relaxed) {
            bail!("stopped");
        }
        if started.elapsed().as_secs_f64() > arguments.within {
            bail!(
                "stopped after {} s with {} of {} trials measured",
                arguments.within,
                check.trials().len(),
                arguments.at.len()
            );
        }
        while let Some(state) = states.receive()? {
            timeout.reset();
            masked.ingest(&state);
            match check.ingest(&state) {
                Some(Event::Ready(index)) => {
                    let [x, y] = arguments.at[index];
                    eprintln!(
                        "{} of {}: hold the {} kg with both hands above {x}, {y} m and stand still",
                        index + 1,
                        arguments.at.len(),
                        arguments.mass_kg
                    );
                }
                Some(Event::Measuring) => eprintln!("  measuring …"),
                Some(Event::Measured) => eprintln!("  measured; put it down"),
                None => {}
            }
        }
        timeout.check()?;
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(check.trials().to_vec())
}

/// Prints why torques are masked, every [`MASKED_INTERVAL`].
struct Masked {
    /// Beginning of the masks, or time of the last line.
    since: Instant,
}

impl Masked {
    fn ingest(&mut self, state: &State) {
        let validity = state.validity();
        if validity == Validity::default() || validity.any_of(Validity::BELOW_LOAD_THRESHOLD) {
            self.since = Instant::now();
        } else if self.since.elapsed() > MASKED_INTERVAL {
            self.since = Instant::now();
            let names: Vec<&str> = validity.names().collect();
            eprintln!("  waiting: {}; `equipoise status` says what to do", names.join(", "));
        }
    }
}

fn mass_sigmas(mass_kg: f64, trial: &Trial) -> f64 {
    (trial.mass_kg - mass_kg) / trial.mass_sigma_kg
}

fn worst_sigmas(mass_kg: f64, trials: &[Trial]) -> f64 {
    let torques = trials.iter().flat_map(|trial| trial.groups.iter().flatten().map(Comparison::sigmas));
    let masses = trials.iter().map(|trial| mass_sigmas(mass_kg, trial));
    // 0/0 is not an agreement.
    let size = |sigmas: f64| if sigmas.is_nan() { f64::INFINITY } else { sigmas.abs() };
    torques.chain(masses).map(size).fold(0.0, f64::max)
}

fn text(mass_kg: f64, trials: &[Trial]) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "at x, y m        quantity     expected  published   1-sigma     error   sigmas");
    let mut line = |at_m: [f64; 2], name: &str, [expected, published, sigma]: [f64; 3]| {
        let error = published - expected;
        let _ = writeln!(
            text,
            "{:>6.2} {:>6.2}    {name:<11} {expected:>9.2}  {published:>9.2} {sigma:>9.2} {error:>+9.2}  {:>+7.1}",
            at_m[0],
            at_m[1],
            error / sigma
        );
    };
    for trial in trials {
        line(trial.at_m, "mass, kg", [mass_kg, trial.mass_kg, trial.mass_sigma_kg]);
        for (group, comparison) in GROUPS.iter().zip(&trial.groups) {
            if let Some(Comparison { expected_nm, published_nm, sigma_nm }) = *comparison {
                line(trial.at_m, &format!("{}, N m", group.name), [expected_nm, published_nm, sigma_nm]);
            }
        }
    }
    text
}

fn json(arguments: &Arguments, trials: &[Trial]) -> Value {
    let unix_s = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let trials_json: Vec<Value> = trials
        .iter()
        .map(|trial| {
            let groups: serde_json::Map<String, Value> = GROUPS
                .iter()
                .zip(&trial.groups)
                .filter_map(|(group, comparison)| {
                    let comparison = (*comparison)?;
                    let value = json!({
                        "expected_nm": comparison.expected_nm, "published_nm": comparison.published_nm,
                        "sigma_nm": comparison.sigma_nm, "error_nm": comparison.error_nm(),
                    });
                    Some((group.name.to_owned(), value))
                })
                .collect();
            json!({
                "at_m": trial.at_m, "mass_kg": trial.mass_kg, "mass_sigma_kg": trial.mass_sigma_kg, "torques": groups,
            })
        })
        .collect();
    let worst = worst_sigmas(arguments.mass_kg, trials);
    json!({
        "unix_s": unix_s,
        "station": arguments.station.station,
        "mass_kg": arguments.mass_kg,
        "gravity_m_per_s2": arguments.gravity,
        "worst_sigmas": worst,
        "within": worst <= SIGMAS_MAX,
        "trials": trials_json,
    })
}

/// Appends one line; only this user may read data of a body.
fn append(path: &Path, result: &Value) -> anyhow::Result<()> {
    std::fs::create_dir_all(path.parent().unwrap_or(path))?;
    write_regular(path, Existing::Append, 0o600)?.write_all(format!("{result}\n").as_bytes())?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use rustix::fs::{CWD, Mode, mkfifoat};

    use super::*;

    const CONFIG: &str = "station = \"s\"\n[suit]\nsource = \"external\"\n[ground]\nsource = \
                          \"external\"\n[subject]\nid = \"a\"\nheight_m = 1.7\n";

    #[test]
    fn a_result_is_appended_to_a_regular_file_only() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("subjects").join("a.load-checks.jsonl");
        append(&path, &json!({"mass_kg": 10})).unwrap();
        append(&path, &json!({"mass_kg": 20})).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "{\"mass_kg\":10}\n{\"mass_kg\":20}\n");
        let pipe = directory.path().join("pipe");
        mkfifoat(CWD, &pipe, Mode::RUSR | Mode::WUSR).unwrap();
        // An ordinary open would wait for a reader.
        assert!(append(&pipe, &json!({})).unwrap_err().to_string().contains("no regular file"));
    }

    #[test]
    fn a_result_is_stored_only_with_the_profile_of_the_measured_subject() {
        let directory = tempfile::tempdir().unwrap();
        let state = StateDirectory::at(directory.path());
        std::fs::create_dir_all(state.profiles()).unwrap();
        for subject in ["a", "b"] {
            std::fs::write(state.profile(subject), "").unwrap();
        }
        let status = |subject: &str| -> Status {
            let status = json!({
                "version": "", "process_id": 1, "station": "s", "config_toml": CONFIG, "memory_lock": "", "threads": [],
                "subject": subject, "state_directory": directory.path(),
            });
            serde_json::from_value(status).unwrap()
        };
        let file = |before: &str, after: &Status| results_file(&status(before), Some(after)).unwrap();
        assert_eq!(file("a", &status("a")), Ok(state.load_checks("a")));
        assert_eq!(results_file(&status("a"), None).unwrap(), Err("the daemon has ended".to_owned()));
        for (before, after, expected) in [
            (status("a"), status("b"), "a was in use at the start, and b at the end"),
            (status(""), status("b"), "an unnamed worker was in use"),
            (status("a"), status(""), "the worker has no name"),
            (status("c"), status("c"), "there is no profile c"),
        ] {
            let refusal = file(&before.subject, &after).unwrap_err();
            assert!(refusal.contains(expected), "{refusal}");
        }
        let mut unsaved = status("a");
        unsaved.config_toml = CONFIG.replace("[subject]", "[subject]\nsave_profile = false");
        assert!(file("a", &unsaved).unwrap_err().contains("save_profile is false"));
        unsaved = status("a");
        unsaved.incidents.insert(Incident::NotSaved.name().to_owned(), "a is in use elsewhere".to_owned());
        assert_eq!(file("a", &unsaved), Err("a is in use elsewhere".to_owned()));
    }
}
