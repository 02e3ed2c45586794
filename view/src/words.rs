//! What a state means in plain English: the worker's page and the terminal say the same.

use equipoise_core::body::{Joint, Segment};
use equipoise_core::cycle::POSE_REACHED_RAD;
use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use serde::Serialize;

use crate::state_json::level_name;

/// A reason why values are withheld.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Reason {
    /// The public name, as in the JSON's `valid`.
    pub name: &'static str,
    /// What it means and what to do.
    pub text: &'static str,
    /// Whether somebody must look after the equipment, rather than the worker go on with the work.
    pub fault: bool,
}

/// The reasons raised in a state, faults first.
pub fn reasons(state: &State) -> Vec<Reason> {
    let mut reasons: Vec<Reason> = state.validity().names().map(reason).collect();
    reasons.sort_by_key(|reason| !reason.fault);
    reasons
}

fn reason(name: &'static str) -> Reason {
    let (text, fault) = match name {
        "suit_stale" => ("The suit is silent: check that it is on and that its software is sending.", true),
        "ground_stale" => ("The force plate is silent: check its power and its cable.", true),
        "not_identified" => ("Your body is not measured yet: follow the poses on the screen.", false),
        "moving" => ("You are moving: the load is judged again when you slow down.", false),
        "feet_off_plate" => ("Your feet are off the plate: step onto it with both feet.", false),
        "below_load_threshold" => ("You carry no load: there is nothing to judge.", false),
        "model_changed" => ("The measurement of your body has just been renewed: one moment.", false),
        "clock_unsynchronised" => ("The sensors are still finding a common time: one moment.", false),
        "load_not_at_hands" => {
            ("The load does not seem to be in your hands: are you leaning on something?", false)
        }
        "mass_unknown" => ("Your weight is not known yet: stand still on the plate.", false),
        "body_unknown" => ("The suit is still being measured: one moment.", false),
        "plate_fault" => ("The force plate reports a fault: it needs attention.", true),
        // A reason of a later version is still better named than hidden.
        later => (later, false),
    };
    Reason { name, text, fault }
}

/// The phase, as a worker would say it.
pub fn phase(state: &State) -> &'static str {
    match Phase::from_number(state.phase) {
        Some(Phase::Waiting) => "Waiting",
        Some(Phase::Identifying) => "Learning your body",
        Some(Phase::Monitoring) => "Watching the load",
        Some(Phase::Degraded) => "A sensor is silent",
        None => "Unknown phase",
    }
}

/// The one thing to tell the worker now.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Instruction {
    /// A few words, to be read from the plate.
    pub text: String,
    /// How it is meant.
    pub tone: Tone,
}

/// How an instruction is meant; the page colours it so.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Tone {
    /// Something to do or to know.
    Calm,
    /// All is well: go on.
    Good,
    /// Take care.
    Warn,
    /// Stop, or call somebody.
    Alarm,
}

impl Instruction {
    fn new(text: impl Into<String>, tone: Tone) -> Instruction {
        Instruction { text: text.into(), tone }
    }
}

/// The one thing to tell the worker now. `pose` is the name of the suggested pose, if there is one.
pub fn instruction(state: &State, pose: Option<&str>) -> Instruction {
    let reasons = reasons(state);
    if let Some(fault) = reasons.first().filter(|reason| reason.fault) {
        return Instruction::new(headline(fault.text), Tone::Alarm);
    }
    let first_of = |spoilers: &[Validity]| {
        reasons.iter().find(|reason| spoilers.iter().any(|bit| bit.names().any(|name| name == reason.name)))
    };
    let calm = |reason: &Reason| Instruction::new(headline(reason.text), Tone::Calm);
    match Phase::from_number(state.phase) {
        // Without these nothing is learnt, however well the pose is held.
        Some(Phase::Identifying) => first_of(&[Validity::FEET_OFF_PLATE, Validity::MASS_UNKNOWN])
            .map_or_else(|| pose_to_take(state, pose), calm),
        Some(Phase::Monitoring) => match worst_joint(state) {
            Some(worst) => overload(worst, state.joint_level[worst.index()]),
            // Who is known is asked for a pose only to tell explanations of a discrepancy apart.
            None if pose.is_some() => first_of(&[Validity::FEET_OFF_PLATE, Validity::MASS_UNKNOWN])
                .map_or_else(|| pose_to_take(state, pose), calm),
            None => reasons.first().map_or_else(|| Instruction::new("No values", Tone::Calm), calm),
        },
        // Not to be identified yet is what waiting is about.
        _ => reasons
            .iter()
            .find(|reason| reason.name != "not_identified")
            .map_or_else(|| Instruction::new("Ready to start", Tone::Calm), calm),
    }
}

fn pose_to_take(state: &State, pose: Option<&str>) -> Instruction {
    let still = state.static_pose != 0;
    match pose {
        Some(name) if state.pose_mismatch_rad >= POSE_REACHED_RAD => {
            Instruction::new(format!("Take the grey pose: {name}"), Tone::Calm)
        }
        _ if still => Instruction::new("Good. Hold still", Tone::Good),
        Some(_) => Instruction::new("Hold still", Tone::Calm),
        None => Instruction::new("Take a new pose and hold still", Tone::Calm),
    }
}

fn overload(worst: Joint, level: u32) -> Instruction {
    let joint = capitalised(joint(worst));
    match level_name(level) {
        "orange" => Instruction::new(format!("{joint}: medium load"), Tone::Warn),
        "red" => Instruction::new(format!("{joint}: high load"), Tone::Alarm),
        "above_max" => Instruction::new(format!("{joint}: too high, put the load down"), Tone::Alarm),
        "green" => Instruction::new("The load is easy on your joints", Tone::Good),
        "undecided" => {
            Instruction::new(format!("{joint}: the load is not known well enough to judge"), Tone::Calm)
        }
        _ => Instruction::new("The load is not judged", Tone::Calm),
    }
}

/// The part before the colon: what is wrong, without what to do.
fn headline(text: &str) -> &str {
    text.split_once(':').map_or(text, |(what, _)| what)
}

/// The joint that comes closest to its limit; `None` while torques are withheld.
pub fn worst_joint(state: &State) -> Option<Joint> {
    crate::state_json::worst_joint(state)
}

/// Where to move the load, seen from the worker; `None` while nothing is known or nothing would help.
///
/// The direction is taken against the worker's own front, which the line between the hips shows.
pub fn advice(state: &State) -> Option<&'static str> {
    worst_joint(state)?;
    let [x, y, _] = state.advice_direction;
    let hip = |segment: Segment| state.segment_origin_m[segment.index()];
    let (left, right) = (hip(Segment::LeftUpperLeg), hip(Segment::RightUpperLeg));
    let (left_x, left_y) = (left[0] - right[0], left[1] - right[1]);
    let (forward, leftward) = (x * left_y - y * left_x, x * left_x + y * left_y);
    if forward == 0.0 && leftward == 0.0 {
        return None;
    }
    Some(match (forward.abs() >= leftward.abs(), forward < 0.0, leftward < 0.0) {
        (true, true, _) => "Bring the load closer",
        (true, false, _) => "Move the load away from you",
        (false, _, false) => "Move the load to your left",
        (false, _, true) => "Move the load to your right",
    })
}

/// The magnitude of a joint's overload torque. The caller has seen that torques are valid.
pub fn torque_nm(state: &State, joint: Joint) -> f64 {
    let [x, y, z] = state.torque_nm[joint.index()];
    (x * x + y * y + z * z).sqrt()
}

/// A level for people: colours alone say nothing to the colour-blind.
pub fn level(number: u32) -> &'static str {
    match level_name(number) {
        "none" => "not judged",
        "green" => "low",
        "orange" => "medium",
        "red" => "high",
        "above_max" => "too high",
        "undecided" => "not sure",
        other => other,
    }
}

/// A joint for people.
pub fn joint(joint: Joint) -> &'static str {
    match joint.name() {
        "L5S1" => "lower back",
        "L4L3" => "lower spine",
        "L1T12" => "middle spine",
        "T9T8" => "upper spine",
        "T1C7" => "base of the neck",
        "C1Head" => "head",
        "RightT4Shoulder" => "right collarbone",
        "RightShoulder" => "right shoulder",
        "RightElbow" => "right elbow",
        "RightWrist" => "right wrist",
        "LeftT4Shoulder" => "left collarbone",
        "LeftShoulder" => "left shoulder",
        "LeftElbow" => "left elbow",
        "LeftWrist" => "left wrist",
        "RightHip" => "right hip",
        "RightKnee" => "right knee",
        "RightAnkle" => "right ankle",
        "RightBallFoot" => "right ball of the foot",
        "LeftHip" => "left hip",
        "LeftKnee" => "left knee",
        "LeftAnkle" => "left ankle",
        "LeftBallFoot" => "left ball of the foot",
        other => other,
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::overload::Level;

    #[test]
    fn every_reason_and_joint_has_words_of_its_own() {
        for (_, name) in Validity::NAMES {
            assert!(reason(name).text.contains(": "), "{name}");
        }
        for each in Joint::ALL {
            assert_ne!(joint(each), each.name());
        }
    }

    #[test]
    fn a_fault_is_told_before_anything_else() {
        let mut state = State::zeroed();
        state.valid = Validity::NOT_IDENTIFIED.and(Validity::GROUND_STALE).0;
        assert_eq!(reasons(&state)[0].name, "ground_stale");
        assert_eq!(instruction(&state, None), Instruction::new("The force plate is silent", Tone::Alarm));
    }

    #[test]
    fn a_pose_is_taken_then_held() {
        let mut state = State::zeroed();
        state.phase = Phase::Identifying as u32;
        state.valid = Validity::NOT_IDENTIFIED.0;
        let told = |state: &State| instruction(state, Some("arms out")).text;
        // Still, but in another pose: that does not help.
        (state.pose_mismatch_rad, state.static_pose) = (1.0, 1);
        assert_eq!(told(&state), "Take the grey pose: arms out");
        (state.pose_mismatch_rad, state.static_pose) = (0.1, 0);
        assert_eq!(told(&state), "Hold still");
        state.static_pose = 1;
        assert_eq!(told(&state), "Good. Hold still");
        state.valid |= Validity::FEET_OFF_PLATE.0;
        assert_eq!(told(&state), "Your feet are off the plate");
    }

    #[test]
    fn a_known_worker_is_asked_for_a_pose_unless_a_load_is_judged() {
        let mut state = State::zeroed();
        state.phase = Phase::Monitoring as u32;
        state.worst_joint = u32::MAX;
        state.valid = Validity::BELOW_LOAD_THRESHOLD.0;
        state.pose_mismatch_rad = 1.0;
        let told = |state: &State| instruction(state, Some("arms out, to tell this from that")).text;
        assert_eq!(told(&state), "Take the grey pose: arms out, to tell this from that");
        state.valid |= Validity::FEET_OFF_PLATE.0;
        assert_eq!(told(&state), "Your feet are off the plate");
        state.valid = 0;
        state.worst_joint = 0;
        assert_ne!(told(&state), "Take the grey pose: arms out, to tell this from that");
    }

    #[test]
    fn the_worst_joint_is_named_with_its_level() {
        let mut state = State::zeroed();
        state.phase = Phase::Monitoring as u32;
        let knee = Joint::named("RightKnee").unwrap();
        state.worst_joint = knee.index() as u32;
        for (level, told, tone) in [
            (Level::Green, "The load is easy on your joints", Tone::Good),
            (Level::Orange, "Right knee: medium load", Tone::Warn),
            (Level::Red, "Right knee: high load", Tone::Alarm),
            (Level::AboveMax, "Right knee: too high, put the load down", Tone::Alarm),
            (Level::Undecided, "Right knee: the load is not known well enough to judge", Tone::Calm),
        ] {
            state.joint_level[knee.index()] = level as u32;
            assert_eq!(instruction(&state, None), Instruction::new(told, tone));
        }
        state.valid = Validity::MOVING.0;
        assert_eq!(worst_joint(&state), None);
    }

    #[test]
    fn advice_is_given_as_the_worker_stands() {
        let mut state = State::zeroed();
        assert_eq!(advice(&state), None, "no direction");
        state.advice_direction = [-1.0, 0.0, 0.0];
        assert_eq!(advice(&state), None, "no heading");
        // The left hip lies along +Y of a worker who faces +X.
        state.segment_origin_m[Segment::LeftUpperLeg.index()] = [0.0, 0.2, 0.9];
        assert_eq!(advice(&state), Some("Bring the load closer"));
        // The same direction, and the worker turned to the left by a quarter at a time.
        let turned: [([f64; 3], &str); 3] = [
            ([-0.2, 0.0, 0.9], "Move the load to your left"),
            ([0.0, -0.2, 0.9], "Move the load away from you"),
            ([0.2, 0.0, 0.9], "Move the load to your right"),
        ];
        for (left_hip, told) in turned {
            state.segment_origin_m[Segment::LeftUpperLeg.index()] = left_hip;
            assert_eq!(advice(&state), Some(told));
        }
        state.valid = Validity::BELOW_LOAD_THRESHOLD.0;
        assert_eq!(advice(&state), None);
    }
}
