//! Text output of a state: one line for `demo` and pipes, and a block for `status`. No escape codes here.

use std::fmt::Write as _;

use equipoise_core::body::Joint;
use equipoise_core::message::{State, Validity};
use equipoise_core::time::seconds;

use crate::words;

/// Rows of the block: joints left and right.
const ROWS: [(&str, &str, &str); 5] = [
    ("shoulder", "LeftShoulder", "RightShoulder"),
    ("elbow", "LeftElbow", "RightElbow"),
    ("hip", "LeftHip", "RightHip"),
    ("knee", "LeftKnee", "RightKnee"),
    ("ankle", "LeftAnkle", "RightAnkle"),
];

/// The present situation on one line. `pose` is the name of the suggested pose, if there is one.
pub fn live_line(state: &State, pose: Option<&str>) -> String {
    let mut parts = vec![format!("{}: {}", state.phase_name(), words::instruction(state, pose).text)];
    if state.converged == 0 {
        parts.push(progress(state));
    }
    if let Some(load) = load(state) {
        parts.push(load);
    }
    if let Some(worst) = words::worst_joint(state) {
        parts.push(format!("{} {}", words::joint(worst), torque(state, worst)));
        parts.push(fatigue(state, worst));
    }
    parts.join(" | ")
}

/// A block of lines of at most 80 columns: 17, and one for each validity flag in `state.valid`, at most 3.
pub fn dashboard(state: &State, station: &str, pose: Option<&str>) -> String {
    let reasons = words::reasons(state);
    // A silent sensor is also an incident, which is printed below with its remedy.
    let short = |reason: &words::Reason| matches!(reason.name, "suit_stale" | "ground_stale");
    let why = reasons
        .iter()
        .map(|reason| if short(reason) { words::headline(reason.text) } else { reason.text })
        .collect::<Vec<_>>();
    let mut block = String::new();
    let mut line = |text: String| {
        if text.trim().is_empty() {
            return;
        }
        // Writing to a String cannot fail.
        let _ = writeln!(block, "{}", text.chars().take(80).collect::<String>().trim_end());
    };
    line(format!("Equipoise  {station}  {}  cycle {}", state.phase_name(), state.cycle));
    for half in halves(&words::instruction(state, pose).text) {
        line(format!("  {half}"));
    }
    line(format!("  {}", progress(state)));
    line(format!(
        "  suit {}  ground {}{}",
        age(state, Stream::Suit),
        age(state, Stream::Ground),
        delay(state)
    ));
    line(format!("  load          {}", load(state).unwrap_or_else(withheld)));
    let measured = [state.cop_measured_m, state.cop_measured_sigma_m];
    let estimated = [state.cop_estimated_m, state.cop_sigma_m];
    line(format!("  CoP measured  {}", cop(state, Validity::INVALIDATES_COP_MEASURED, measured)));
    line(format!("  CoP estimated {}", cop(state, Validity::INVALIDATES_COP_ESTIMATED, estimated)));
    line(format!("  CoM           {}", centres(state)));
    line(format!("  {:<10}  {:<30}  {:<30}", "overload", "left", "right"));
    for (name, left, right) in ROWS {
        line(format!("  {name:<10}  {:<30}  {:<30}", cell(state, left), cell(state, right)));
    }
    let pressed = back(state).unwrap_or_else(withheld);
    line(format!("  {:<10}  {:<30}  {pressed}", "lower back", cell(state, "L5S1")));
    line(format!("  {:<10}  {}", "worst", worst(state).unwrap_or_else(withheld)));
    line(format!("  {:<10}  {}", "this shift", shift(state)));
    for text in why.iter().take(3) {
        line(format!("  {text}"));
    }
    block
}

/// Splits a text into two lines of the block; the second one may be empty.
fn halves(text: &str) -> [&str; 2] {
    let fits = |at: &usize| text[..*at].chars().count() <= 78;
    let ends = text.match_indices(' ').map(|(at, _)| at).chain([text.len()]);
    let end = ends.filter(fits).max().unwrap_or(text.len());
    [&text[..end], text[end..].trim_start()]
}

pub(crate) fn progress(state: &State) -> String {
    let poses = match state.poses_used {
        1 => "1 pose".to_owned(),
        count => format!("{count} poses"),
    };
    let done = if state.converged != 0 { ", done" } else { "" };
    match state.predicted_cop_sigma_m {
        sigma if sigma > 0.0 => format!("{poses} used, known to ±{:.0} mm{done}", 1e3 * sigma),
        _ => format!("{poses} used{done}"),
    }
}

/// The external force, and the lifted mass where it is valid.
pub(crate) fn load(state: &State) -> Option<String> {
    let [_, _, up_n] = state.unless(Validity::INVALIDATES_DELTA_F, state.delta_f_n)?;
    // Adding zero removes the sign of a rounded -0.3.
    let up_n = up_n.round() + 0.0;
    Some(match state.unless(Validity::INVALIDATES_LIFTED_MASS, state.lifted_mass_kg) {
        Some(kg) => format!("load {up_n:.0} N ({kg:.1} ± {:.1} kg)", state.lifted_mass_sigma_kg),
        None => format!("external force {up_n:.0}{} N", plus_minus(state.delta_f_sigma_n, 0)),
    })
}

pub(crate) fn back(state: &State) -> Option<String> {
    let newtons = state.unless(Validity::INVALIDATES_LOW_BACK, state.l5s1_compression_n)?;
    Some(format!("{newtons:.0} ± {:.0} N on the lowest disc", state.l5s1_compression_sigma_n))
}

pub(crate) fn worst(state: &State) -> Option<String> {
    let joint = words::worst_joint(state)?;
    let advice = words::advice(state).map_or_else(String::new, |advice| {
        format!(": {} ({:.1} N m per cm)", advice.to_lowercase(), state.advice_gain_nm_per_cm)
    });
    Some(format!("{}, {}{advice}", words::joint(joint), fatigue(state, joint)))
}

pub(crate) fn shift(state: &State) -> String {
    let lifts = match state.lifts {
        1 => "1 lift".to_owned(),
        count => format!("{count} lifts"),
    };
    let risk = words::assessed_dose(state)
        .map(|[_, probability]| format!("risk of a day like this {:.0} %", 100.0 * probability));
    let (index, tired) =
        state.fatigue.iter().copied().enumerate().fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
    let fatigue = (tired > 0.0)
        .then(|| format!("most tired {} {:.0} %", words::joint(Joint::ALL[index]), 100.0 * tired));
    [Some(lifts), risk, fatigue].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

fn fatigue(state: &State, joint: Joint) -> String {
    format!("tired {:.0} %", 100.0 * state.fatigue[joint.index()])
}

fn torque(state: &State, joint: Joint) -> String {
    let index = joint.index();
    format!(
        "{:.0} ± {:.0} N m, {}",
        words::torque_nm(state, joint),
        state.torque_sigma_nm[index],
        words::level(state.joint_level[index])
    )
}

fn cell(state: &State, joint: &str) -> String {
    Joint::named(joint)
        .and_then(|joint| state.unless(Validity::INVALIDATES_TORQUES, joint))
        .map_or_else(withheld, |joint| torque(state, joint))
}

/// A centre of pressure and its 1-σ, both m.
fn cop(state: &State, invalidating: Validity, cop_m: [[f64; 2]; 2]) -> String {
    let Some([[x, y], sigma_m]) = state.unless(invalidating, cop_m) else { return withheld() };
    let [x_sigma, y_sigma] = sigma_m.map(|sigma_m| plus_minus(1e3 * sigma_m, 1));
    format!("forward {:>7.1}{x_sigma} mm  left {:>7.1}{y_sigma} mm", 1e3 * x, 1e3 * y)
}

/// A 1-σ after its value; empty while it is unavailable.
fn plus_minus(sigma: f64, decimals: usize) -> String {
    if sigma > 0.0 { format!(" ± {sigma:.decimals$}") } else { String::new() }
}

/// The estimated centre of mass, and its distance from the suit maker's.
fn centres(state: &State) -> String {
    let Some(com_m) = state.unless(Validity::INVALIDATES_COM, state.com_m) else { return withheld() };
    let [x, y, z] = com_m.map(|metres| 1e3 * metres);
    let own = state.suit_com_m().map_or_else(String::new, |suit_m| {
        let [x, y, z] = core::array::from_fn(|axis| 1e3 * (suit_m[axis] - com_m[axis]));
        format!("; the suit's own {x:+.0} {y:+.0} {z:+.0}")
    });
    format!("forward {x:.0} left {y:.0} up {z:.0} mm{own}")
}

fn withheld() -> String {
    "-".to_owned()
}

enum Stream {
    Suit,
    Ground,
}

fn age(state: &State, stream: Stream) -> String {
    let (age_ns, silent) = match stream {
        Stream::Suit => (state.suit_age_ns, Validity::SUIT_STALE),
        Stream::Ground => (state.ground_age_ns, Validity::GROUND_STALE),
    };
    match state.unless(silent, age_ns) {
        Some(age_ns) => format!("{:.0} ms old", 1e3 * seconds(age_ns)),
        None => "silent".to_owned(),
    }
}

/// Ages are those of the newest samples; results are older by the group delay of the motion window.
fn delay(state: &State) -> String {
    match state.group_delay_ns {
        0 => String::new(),
        delay_ns => format!("  values {:.0} ms behind the suit", 1e3 * seconds(delay_ns)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::body::Segment;
    use equipoise_core::message::state::{Phase, Unavailable};

    fn carrying() -> State {
        let mut state = State::zeroed();
        state.cycle = 42;
        state.phase = Phase::Monitoring as u32;
        state.converged = 1;
        state.poses_used = 9;
        state.predicted_cop_sigma_m = 0.0062;
        state.delta_f_n = [0.0, 0.0, 98.0665];
        let knee = Joint::named("LeftKnee").unwrap().index();
        state.torque_nm[knee] = [0.0, 43.2, 0.0];
        state.torque_sigma_nm[knee] = 3.9;
        state.joint_level[knee] = 3;
        state.worst_joint = knee as u32;
        state.fatigue[knee] = 0.31;
        (state.lifted_mass_kg, state.lifted_mass_sigma_kg) = (10.0, 0.3);
        (state.l5s1_compression_n, state.l5s1_compression_sigma_n) = (2410.0, 390.0);
        (state.lifts, state.dose_damage, state.dose_probability) = (12, 1e-4, 0.07);
        state.advice_direction = [-1.0, 0.0, 0.0];
        state.advice_gain_nm_per_cm = 0.49;
        state.segment_origin_m[Segment::LeftUpperLeg.index()] = [0.0, 0.2, 0.9];
        state
    }

    #[test]
    fn a_line_says_what_is_wrong_and_how_sure_it_is() {
        assert_eq!(
            live_line(&carrying(), None),
            "monitoring: Left knee: high load | load 98 N (10.0 ± 0.3 kg) | left knee 43 ± 4 N m, high | tired 31 %"
        );
    }

    #[test]
    fn a_force_without_a_load_is_an_external_force_with_its_sigma() {
        for valid in [Validity::BELOW_LOAD_THRESHOLD, Validity::WEIGHT_MISSING] {
            let mut state = State { valid: valid.0, delta_f_sigma_n: 12.0, ..carrying() };
            state.delta_f_n[2] = -80.0;
            let line = live_line(&state, None);
            assert!(line.contains("external force -80 ± 12 N") && !line.contains("load -80"), "{line}");
        }
    }

    #[test]
    fn a_centre_of_pressure_has_its_sigma() {
        let mut state = State { cop_measured_m: [0.1234, -0.02], ..carrying() };
        state.cop_measured_sigma_m = [0.0012, 0.0015];
        let block = dashboard(&state, "station-1", None);
        for line in [
            "  CoP measured  forward   123.4 ± 1.2 mm  left   -20.0 ± 1.5 mm",
            "  CoP estimated forward     0.0 mm  left     0.0 mm",
        ] {
            assert!(block.lines().any(|shown| shown == line), "{line}\n{block}");
        }
    }

    #[test]
    fn a_withheld_value_is_not_printed() {
        let mut state = carrying();
        state.valid = Validity::GROUND_STALE.0;
        assert_eq!(live_line(&state, None), "monitoring: The force plate is silent");
        let block = dashboard(&state, "station-1", None);
        assert!(!block.contains("43") && block.contains("ground silent"), "{block}");
    }

    #[test]
    fn the_block_shows_the_load_of_the_back_and_the_advice() {
        let block = dashboard(&carrying(), "station-1", None);
        for line in [
            "  lower back  0 ± 0 N m, not evaluated        2410 ± 390 N on the lowest disc",
            "  worst       left knee, tired 31 %: bring the load closer (0.5 N m per cm)",
            "  this shift  12 lifts, risk of a day like this 7 %, most tired left knee 31 %",
        ] {
            assert!(block.lines().any(|shown| shown == line), "{line}\n{block}");
        }
        let mut moving = carrying();
        moving.valid = Validity::MOVING.0;
        let block = dashboard(&moving, "station-1", None);
        assert!(!block.contains("98 N") && !block.contains("2410"), "{block}");
        assert!(block.contains("12 lifts"), "sums are always shown: {block}");
    }

    #[test]
    fn before_the_first_lift_there_is_no_risk() {
        let mut state = State { lifts: 0, dose_damage: 0.0, dose_probability: 0.0, ..carrying() };
        assert_eq!(shift(&state), "0 lifts, most tired left knee 31 %");
        state.fatigue = State::zeroed().fatigue;
        assert_eq!(shift(&state), "0 lifts");
    }

    #[test]
    fn the_suit_s_centre_of_mass_is_shown_next_to_the_estimated_one() {
        let mut state = State { com_m: [0.03, -0.02, 0.98], suit_com_m: [0.045, -0.02, 0.95], ..carrying() };
        let line = "  CoM           forward 30 left -20 up 980 mm; the suit's own +15 +0 -30";
        assert!(dashboard(&state, "station-1", None).lines().any(|shown| shown == line));
        state.unavailable = Unavailable::SuitCom as u32;
        assert!(!dashboard(&state, "station-1", None).contains("the suit's own"));
    }

    #[test]
    fn the_block_says_how_far_the_values_lie_behind() {
        let shown = |group_delay_ns| {
            let state = State { suit_age_ns: 4_000_000, group_delay_ns, ..carrying() };
            dashboard(&state, "station-1", None).lines().nth(3).map(str::to_owned)
        };
        assert_eq!(
            shown(66_700_000).as_deref(),
            Some("  suit 4 ms old  ground 0 ms old  values 67 ms behind the suit")
        );
        assert_eq!(shown(0).as_deref(), Some("  suit 4 ms old  ground 0 ms old"));
    }

    #[test]
    fn a_long_instruction_goes_on_in_the_next_line() {
        let mut state = carrying();
        (state.worst_joint, state.valid, state.pose_mismatch_rad) = (u32::MAX, 0, 1.0);
        let pose = "turn by 90° to the left, both arms up and out, like a Y, to tell hand_load right from worn_mass T8";
        let block = dashboard(&state, "station-1", Some(pose));
        let shown: Vec<&str> = block.lines().skip(1).take(2).map(str::trim).collect();
        assert_eq!(shown.join(" "), format!("Take this pose: {pose}"));
        assert_eq!(halves("short"), ["short", ""]);
    }

    #[test]
    fn the_block_leaves_room_for_sensors_on_a_screen() {
        for (valid, lines) in [(0, 17), (Validity::MOVING.0, 18), (u64::MAX, 20)] {
            let block = dashboard(&State { valid, ..carrying() }, "station-1", Some("arms out"));
            assert_eq!(block.lines().count(), lines, "{block}");
            assert!(block.lines().all(|line| line.chars().count() <= 80), "{block}");
        }
    }
}
