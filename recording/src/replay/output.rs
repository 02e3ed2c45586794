//! Writes the states of a replay as JSON lines, CSV, or a recording of states and, as their period and the changes of
//! the subject are in them, of the replayed cycle records.
//!
//! The CSV holds a subset, one line per cycle; an invalid value is an empty field, as its key is absent in the JSON:
//!
//! | columns | unit |
//! |---|---|
//! | `t_s` | seconds in the recording's own clock |
//! | `cycle`, `phase`, `valid` (names, separated by spaces) | |
//! | `static_pose`, `converged` (0 or 1), `poses_used`, `stance` | |
//! | `suit_sample_t_s`: the instant that the values belong to | s, as `t_s` |
//! | `cop_measured_x_m`, `_y_m`, `cop_estimated_x_m`, `_y_m`, `cop_sigma_x_m`, `_y_m` | m |
//! | `com_x_m`, `_y_m`, `_z_m`; the suit maker's own `suit_com_x_m`, `_y_m`, `_z_m` | m |
//! | `mass_kg`, `ground_force_z_n`, `delta_f_z_n`, `load_hand_distance_m` | kg, N, N, m |
//! | `lifted_mass_kg`, `lifted_mass_sigma_kg`, `reach_m` | kg, kg, m |
//! | `l5s1_moment_nm`, `l5s1_moment_sigma_nm`, `l5s1_compression_n`, `l5s1_compression_sigma_n` | N m, N m, N, N |
//! | `lifts`, `dose_damage`, `dose_probability`: always present | count, 1, 1 |
//! | `worst_joint` (MVN's name) | |
//! | `advice_x`, `advice_y`, `advice_gain_nm_per_cm`: recommended direction of the load | 1, 1, N m/cm |
//! | per joint in MVN's order `NAME_torque_nm`, `NAME_sigma_nm`: overload torque's magnitude and its 1-σ | N m |
//! | after them `NAME_level`, `NAME_fatigue` (always present) | name, 0 to 1 |

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use anyhow::{Context, bail};
use equipoise_adapters::recording::{Recorder, RecordingHeader};
use equipoise_core::body::Joint;
use equipoise_core::message::{CycleRecord, State, Validity};
use equipoise_view::state_json::{StateJson, level_name};
use equipoise_view::words;

/// Destination of states.
pub(super) struct Output {
    sink: Sink,
    started_ns: u64,
    line: String,
}

enum Sink {
    Discard,
    Json(Box<dyn Write>),
    Csv(Box<dyn Write>),
    Mcap(Box<Recorder>),
}

impl Output {
    /// No output.
    pub(super) fn discard() -> Output {
        Output { sink: Sink::Discard, started_ns: 0, line: String::new() }
    }

    /// A file, with the format given by its extension; `-` writes JSON lines to standard output. A recording is never
    /// overwritten, text files are.
    ///
    /// # Errors
    /// An unknown extension, or a file that cannot be created.
    pub(super) fn create(path: &Path, header: &RecordingHeader) -> anyhow::Result<Output> {
        let create = || -> anyhow::Result<Box<dyn Write>> {
            let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
            Ok(Box::new(BufWriter::new(file)))
        };
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        let sink = match ending.as_deref() {
            Some("jsonl") => Sink::Json(create()?),
            Some("csv") => {
                let mut file = create()?;
                file.write_all(csv_head().as_bytes())?;
                Sink::Csv(file)
            }
            Some("mcap") => Sink::Mcap(Box::new(Recorder::create(path, header)?)),
            _ if path.as_os_str() == "-" => Sink::Json(Box::new(BufWriter::new(io::stdout()))),
            _ => bail!("--out {}: give a name that ends in .jsonl, .csv or .mcap, or -", path.display()),
        };
        Ok(Output { sink, started_ns: header.started_monotonic_ns, line: String::new() })
    }

    /// Writes one state, and into a recording the record of its cycle, if any.
    ///
    /// # Errors
    /// The system's error, for example a full disk.
    pub(super) fn write(&mut self, state: &State, record: Option<&CycleRecord>) -> anyhow::Result<()> {
        match &mut self.sink {
            Sink::Discard => {}
            Sink::Json(file) => {
                let json = StateJson::new(state, seconds_since(self.started_ns, state.time_ns));
                self.line = json.to_text()?;
                self.line.push('\n');
                file.write_all(self.line.as_bytes()).context("cannot write the result")?;
            }
            Sink::Csv(file) => {
                self.line.clear();
                csv_line(&mut self.line, state, self.started_ns)?;
                file.write_all(self.line.as_bytes()).context("cannot write the result")?;
            }
            Sink::Mcap(recorder) => {
                recorder.write(state.time_ns, state)?;
                record.map_or(Ok(()), |record| recorder.write(record.due_ns, record))?;
            }
        }
        Ok(())
    }

    /// Flushes and closes the output.
    ///
    /// # Errors
    /// The system's error.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        match self.sink {
            Sink::Discard => Ok(()),
            Sink::Json(mut file) | Sink::Csv(mut file) => file.flush().context("cannot write the result"),
            Sink::Mcap(recorder) => {
                recorder.finish()?;
                Ok(())
            }
        }
    }
}

/// A time on the recording's own clock, s.
pub(super) fn seconds_since(started_ns: u64, time_ns: u64) -> f64 {
    // Division is more exact than multiplication: 34 ms gives 0.034, not 0.034000000000000002.
    (i128::from(time_ns) - i128::from(started_ns)) as f64 / 1e9
}

fn csv_head() -> String {
    let mut head = "t_s,cycle,phase,valid,static_pose,converged,poses_used,stance,suit_sample_t_s,cop_measured_x_m,\
                    cop_measured_y_m,cop_estimated_x_m,cop_estimated_y_m,cop_sigma_x_m,cop_sigma_y_m,com_x_m,com_y_m,\
                    com_z_m,suit_com_x_m,suit_com_y_m,suit_com_z_m,mass_kg,ground_force_z_n,delta_f_z_n,load_hand_distance_m,lifted_mass_kg,lifted_mass_sigma_kg,\
                    reach_m,l5s1_moment_nm,l5s1_moment_sigma_nm,l5s1_compression_n,l5s1_compression_sigma_n,lifts,\
                    dose_damage,dose_probability,worst_joint,advice_x,advice_y,advice_gain_nm_per_cm"
        .to_owned();
    for joint in Joint::ALL {
        for quantity in ["torque_nm", "sigma_nm", "level", "fatigue"] {
            head.push_str(&format!(",{}_{quantity}", joint.name()));
        }
    }
    head.push('\n');
    head
}

fn csv_line(line: &mut String, state: &State, started_ns: u64) -> std::fmt::Result {
    let valid: Vec<&str> = state.validity().names().collect();
    write!(line, "{},{},", seconds_since(started_ns, state.time_ns), state.cycle)?;
    write!(line, "{},{},", state.phase_name(), valid.join(" "))?;
    write!(line, "{},{},{},{},", state.static_pose, state.converged, state.poses_used, state.stance)?;
    if state.suit_sample_time_ns > 0 {
        write!(line, "{}", seconds_since(started_ns, state.suit_sample_time_ns))?;
    }
    measured(line, state)?;
    exposure(line, state)?;
    for joint in Joint::ALL {
        let index = joint.index();
        let [x, y, z] = state.torque_nm[index];
        let magnitude_nm = (x * x + y * y + z * z).sqrt();
        let torque = [magnitude_nm, state.torque_sigma_nm[index]];
        fields(line, state, Validity::INVALIDATES_TORQUES, &torque)?;
        let level = state.unless(Validity::INVALIDATES_TORQUES, level_name(state.joint_level[index]));
        write!(line, ",{}", level.unwrap_or_default())?;
        fields(line, state, Validity::default(), &[state.fatigue[index]])?;
    }
    line.push('\n');
    Ok(())
}

/// Writes each value after a comma; invalid values are empty.
fn fields(line: &mut String, state: &State, invalidating: Validity, values: &[f64]) -> std::fmt::Result {
    for value in values {
        line.push(',');
        if !state.validity().any_of(invalidating) && value.is_finite() {
            write!(line, "{value}")?;
        }
    }
    Ok(())
}

fn measured(line: &mut String, state: &State) -> std::fmt::Result {
    let mut fields = |invalidating: Validity, values: &[f64]| fields(line, state, invalidating, values);
    fields(Validity::INVALIDATES_COP_MEASURED, &state.cop_measured_m)?;
    fields(Validity::INVALIDATES_COP_ESTIMATED, &state.cop_estimated_m)?;
    fields(Validity::INVALIDATES_COP_ESTIMATED, &state.cop_sigma_m)?;
    fields(Validity::INVALIDATES_COM, &state.com_m)?;
    match state.suit_com_m() {
        Some(com_m) => fields(Validity::default(), &com_m)?,
        None => fields(Validity(u64::MAX), &[0.0; 3])?,
    }
    fields(Validity::MASS_UNKNOWN, &[state.mass_kg])?;
    fields(Validity::INVALIDATES_GROUND_FORCE, &state.ground_force_n[2..])?;
    fields(Validity::INVALIDATES_DELTA_F, &state.delta_f_n[2..])?;
    fields(Validity::INVALIDATES_LOAD_HAND_DISTANCE, &[state.load_hand_distance_m])
}

fn exposure(line: &mut String, state: &State) -> std::fmt::Result {
    let lifted = [state.lifted_mass_kg, state.lifted_mass_sigma_kg];
    fields(line, state, Validity::INVALIDATES_LIFTED_MASS, &lifted)?;
    fields(line, state, Validity::INVALIDATES_TORQUES, &[state.reach_m])?;
    let moment = [state.l5s1_moment_nm, state.l5s1_moment_sigma_nm];
    fields(line, state, Validity::INVALIDATES_LOW_BACK, &moment)?;
    let compression = [state.l5s1_compression_n, state.l5s1_compression_sigma_n];
    fields(line, state, Validity::INVALIDATES_LOW_BACK, &compression)?;
    write!(line, ",{}", state.lifts)?;
    fields(line, state, Validity::default(), &[state.dose_damage, state.dose_probability])?;
    write!(line, ",{}", words::worst_joint(state).map_or("", Joint::name))?;
    let [x, y, _] = state.advice_direction;
    // A zero direction means that there is no advice.
    if [x, y] == [0.0; 2] {
        line.push_str(",,,");
        return Ok(());
    }
    fields(line, state, Validity::INVALIDATES_TORQUES, &[x, y, state.advice_gain_nm_per_cm])
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_line_has_a_field_for_every_column_and_masks_invalid_values() {
        let mut state = State::zeroed();
        state.time_ns = 1_034_000_000;
        state.cop_measured_m = [0.25, -0.5];
        state.valid = Validity::SUIT_STALE.and(Validity::MASS_UNKNOWN).0;
        let mut line = String::new();
        csv_line(&mut line, &state, 1_000_000_000).unwrap();
        let head = csv_head();
        assert_eq!(line.split(',').count(), head.split(',').count());
        // Two columns each of the estimate and its σ, three of each centre of mass, one of the mass.
        let withheld = ",".repeat(2 + 2 + 3 + 3 + 1);
        let start = format!("0.034,0,waiting,suit_stale mass_unknown,0,0,0,0,,0.25,-0.5{withheld},0,,,");
        assert!(line.starts_with(&start), "{line}");
    }

    #[test]
    fn load_low_back_and_advice_have_separate_columns() {
        let mut state = State::zeroed();
        (state.lifted_mass_kg, state.reach_m, state.l5s1_compression_n) = (6.5, 0.5, 2400.0);
        (state.lifts, state.worst_joint, state.fatigue[0]) = (3, 0, 0.25);
        (state.advice_direction, state.advice_gain_nm_per_cm) = ([-1.0, 0.0, 0.0], 0.5);
        state.joint_level[0] = 5;
        let cell = |state: &State, column: &str| {
            let mut line = String::new();
            csv_line(&mut line, state, 0).unwrap();
            let head = csv_head();
            let at = head.trim_end().split(',').position(|name| name == column).unwrap();
            line.trim_end().split(',').nth(at).unwrap().to_owned()
        };
        for (column, value) in [
            ("lifted_mass_kg", "6.5"),
            ("reach_m", "0.5"),
            ("l5s1_compression_n", "2400"),
            ("lifts", "3"),
            ("worst_joint", "L5S1"),
            ("advice_x", "-1"),
            ("advice_gain_nm_per_cm", "0.5"),
            ("L5S1_level", "undecided"),
            ("L5S1_fatigue", "0.25"),
        ] {
            assert_eq!(cell(&state, column), value, "{column}");
        }
        state.valid = Validity::BELOW_LOAD_THRESHOLD.0;
        for column in ["lifted_mass_kg", "reach_m", "worst_joint", "advice_x", "L5S1_level"] {
            assert_eq!(cell(&state, column), "", "{column}");
        }
        assert_eq!(cell(&state, "l5s1_compression_n"), "2400");
        assert_eq!(cell(&state, "L5S1_fatigue"), "0.25");
        (state.com_m[0], state.valid) = (0.03, Validity::MOVING.0);
        assert_eq!(["com_x_m", "cop_estimated_x_m"].map(|column| cell(&state, column)), ["0.03", ""]);
    }
}
