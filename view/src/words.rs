//! What a state means in plain English: the worker's page and the terminal say the same. The sentences themselves stand
//! in the table of each language ([`table`]); texts for the worker have a key, so that a page can say it in
//! another one.

mod headline_joint;
pub mod table;

use std::collections::BTreeMap;

use equipoise_core::body::{Joint, Segment};
use equipoise_core::cycle::{BodyRejection, BodySource, POSE_REACHED_RAD};
use equipoise_core::message::state::{FootOutlineSource, Phase};
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use serde::Serialize;

use crate::state_json::level_name;
pub use headline_joint::{JointLoad, headline_joint, headline_of};
use table::{english, english_or};

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

/// The withheld quantities by their public names ([`Validity::FLAG_SETS`]), each with its first reason, faults first.
pub(crate) fn withheld(state: &State) -> BTreeMap<&'static str, &'static str> {
    let reasons = reasons(state);
    let first = |set: &Validity| reasons.iter().find(|reason| set.names().any(|name| name == reason.name));
    Validity::FLAG_SETS.iter().filter_map(|(set, name)| Some((*name, first(set)?.name))).collect()
}

/// What is wrong with the equipment, rather than with what the worker does.
const FAULTS: Validity = Validity::SUIT_STALE.and(Validity::GROUND_STALE).and(Validity::PLATE_FAULT);

/// A reason by its public name.
pub fn reason(name: &'static str) -> Reason {
    // A reason of a later version has no text here; it is displayed by its name.
    Reason { name, text: english_or("reason", name), fault: FAULTS.names().any(|fault| fault == name) }
}

/// Where the worker's bones and soles come from, and why not from the suit if it was refused.
pub fn body(state: &State) -> String {
    let bones = match BodySource::from_number(state.body_source) {
        Some(BodySource::NullPose) => "from the suit's null pose",
        Some(BodySource::Poses) => "bones learnt from the poses",
        Some(BodySource::Stored) => "bones of the stored profile",
        Some(BodySource::Unknown) | None => "bones not known yet",
    };
    let soles = match FootOutlineSource::from_number(state.foot_outline_source) {
        Some(FootOutlineSource::Suit) => "soles from the suit's points of the feet",
        _ => "soles by stature",
    };
    let refused = match BodyRejection::from_number(state.body_rejected) {
        Some(BodyRejection::Impossible) => "; its null pose is refused: not a possible human body",
        Some(BodyRejection::Stale) => "; its null pose is refused: it is of a session that has ended, or old",
        Some(BodyRejection::OtherCharacter) => "; its null pose is refused: it is another character's",
        Some(BodyRejection::ContradictsPoses) => {
            "; its null pose is refused: its bones are not those of the poses, which are kept to"
        }
        Some(BodyRejection::ContradictsWorker) => {
            "; its null pose has other segment lengths than the identification of this worker: is it the right subject?"
        }
        Some(BodyRejection::None) | None => "",
    };
    format!("{bones}; {soles}{refused}")
}

/// The phase, as a worker would say it.
pub fn phase(state: &State) -> &'static str {
    english_or("phase", Phase::from_number(state.phase).map_or("unknown", Phase::name))
}

/// The one thing to tell the worker now.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Instruction {
    /// A few words, to be read from the plate.
    pub text: String,
    /// How it is meant.
    pub tone: Tone,
    /// Key of the sentence in the tables; of a reason only what stands before its colon is said.
    pub key: String,
    /// Name of the joint that stands in the sentence for `{joint}`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<&'static str>,
    /// English name of the pose that stands in the sentence for `{pose}`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose: Option<String>,
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
    fn new(name: &'static str, tone: Tone) -> Instruction {
        let text = english_or("instruction", name).to_owned();
        Instruction { text, tone, key: format!("instruction.{name}"), joint: None, pose: None }
    }

    fn of_reason(reason: &Reason, tone: Tone) -> Instruction {
        let (text, key) = (headline(reason.text).to_owned(), format!("reason.{}", reason.name));
        Instruction { text, tone, key, joint: None, pose: None }
    }

    fn about_joint(mut self, joint: Joint) -> Instruction {
        self.text = self.text.replace("{joint}", &capitalised(self::joint(joint)));
        Instruction { joint: Some(joint.name()), ..self }
    }

    fn about_pose(mut self, pose: &str) -> Instruction {
        self.text = self.text.replace("{pose}", pose);
        Instruction { pose: Some(pose.to_owned()), ..self }
    }
}

/// The one thing to tell the worker now. `pose` is the name of the suggested pose, if there is one.
pub fn instruction(state: &State, pose: Option<&str>) -> Instruction {
    let reasons = reasons(state);
    if let Some(fault) = reasons.first().filter(|reason| reason.fault) {
        return Instruction::of_reason(fault, Tone::Alarm);
    }
    let first_of = |invalidating: &[Validity]| {
        reasons
            .iter()
            .find(|reason| invalidating.iter().any(|bit| bit.names().any(|name| name == reason.name)))
    };
    let calm = |reason: &Reason| Instruction::of_reason(reason, Tone::Calm);
    match Phase::from_number(state.phase) {
        // Without these, identification uses no pose, however static it is.
        Some(Phase::Identifying) => first_of(&[Validity::FEET_OFF_PLATE, Validity::MASS_UNKNOWN])
            .map_or_else(|| pose_to_take(state, pose), calm),
        Some(Phase::Monitoring) => match headline_joint(state) {
            Some((joint, level)) => overload(joint, level),
            // After identification a pose is suggested only to discriminate explanations of a discrepancy.
            None if pose.is_some() => first_of(&[Validity::FEET_OFF_PLATE, Validity::MASS_UNKNOWN])
                .map_or_else(|| pose_to_take(state, pose), calm),
            None => reasons.first().map_or_else(|| Instruction::new("no_values", Tone::Calm), calm),
        },
        // `not_identified` is implied while waiting.
        _ => reasons
            .iter()
            .find(|reason| reason.name != "not_identified")
            .map_or_else(|| Instruction::new("ready", Tone::Calm), calm),
    }
}

fn pose_to_take(state: &State, pose: Option<&str>) -> Instruction {
    let still = state.static_pose != 0;
    match pose {
        Some(name) if state.pose_mismatch_rad().is_none_or(|rad| rad >= POSE_REACHED_RAD) => {
            Instruction::new("take_pose", Tone::Calm).about_pose(name)
        }
        // A pose with a load is not used for identification, however static it is.
        _ if still && is_loaded(state) => Instruction::new("unload", Tone::Calm),
        _ if still => Instruction::new("good_hold", Tone::Good),
        Some(_) => Instruction::new("hold", Tone::Calm),
        None => Instruction::new("new_pose", Tone::Calm),
    }
}

/// Whether something is carried, or the worker's mass or the plate's zero is off by as much.
fn is_loaded(state: &State) -> bool {
    !state.validity().any_of(Validity::INVALIDATES_DELTA_F.and(Validity::BELOW_LOAD_THRESHOLD))
}

fn overload(joint: Joint, level: Level) -> Instruction {
    let (name, tone) = match level {
        Level::Orange => ("orange", Tone::Warn),
        Level::Red => ("red", Tone::Alarm),
        Level::AboveMax => ("above_max", Tone::Alarm),
        Level::Green => return Instruction::new("green", Tone::Good),
        Level::Undecided => ("undecided", Tone::Calm),
        Level::None => return Instruction::new("not_judged", Tone::Calm),
    };
    Instruction::new(name, tone).about_joint(joint)
}

/// The part before the colon: what is wrong, without what to do.
pub(crate) fn headline(text: &str) -> &str {
    text.split_once(':').map_or(text, |(what, _)| what)
}

/// The joint that comes closest to its limit; `None` while torques are withheld.
pub fn worst_joint(state: &State) -> Option<Joint> {
    crate::state_json::worst_joint(state)
}

/// Where to move the load, seen from the worker; `None` without valid torques, if no direction helps, or if the
/// headline's joint is not the worst one or not certainly `orange` or `red`: the direction relieves the worst joint;
/// below these levels no motion is necessary, and above them the load must be put down.
///
/// The direction is taken against the worker's own front, which the line between the hips shows.
pub fn advice(state: &State) -> Option<&'static str> {
    english(&format!("advice.{}", advice_name(state)?))
}

/// The same as the name of a sentence: `closer`, `away`, `left` or `right`.
pub(crate) fn advice_name(state: &State) -> Option<&'static str> {
    let (joint, level) = headline_joint(state)?;
    if worst_joint(state) != Some(joint) || !matches!(level, Level::Orange | Level::Red) {
        return None;
    }
    let [x, y, _] = state.advice_direction;
    let hip = |segment: Segment| state.segment_origin_m[segment.index()];
    let (left, right) = (hip(Segment::LeftUpperLeg), hip(Segment::RightUpperLeg));
    let (left_x, left_y) = (left[0] - right[0], left[1] - right[1]);
    let (forward, leftward) = (x * left_y - y * left_x, x * left_x + y * left_y);
    if forward == 0.0 && leftward == 0.0 {
        return None;
    }
    Some(match (forward.abs() >= leftward.abs(), forward < 0.0, leftward < 0.0) {
        (true, true, _) => "closer",
        (true, false, _) => "away",
        (false, _, false) => "left",
        (false, _, true) => "right",
    })
}

/// The magnitude of a joint's overload torque. The caller has seen that torques are valid.
pub fn torque_nm(state: &State, joint: Joint) -> f64 {
    let [x, y, z] = state.torque_nm[joint.index()];
    (x * x + y * y + z * z).sqrt()
}

/// Damage of the low back (1 is failure) and probability of a high-risk job; `None` before a lift has added damage: an
/// unknown risk is not zero.
pub fn assessed_dose(state: &State) -> Option<[f64; 2]> {
    (state.dose_damage > 0.0).then_some([state.dose_damage, state.dose_probability])
}

/// A level for people: colours alone say nothing to the colour-blind. Tables and figures next to a torque say of
/// what it is; only a sentence needs the word for it, and there is no place for it there.
pub fn level(number: u32) -> &'static str {
    english_or("level", level_name(number)).trim_end_matches(" load")
}

/// A joint for people.
pub fn joint(joint: Joint) -> &'static str {
    english_or("joint", joint.name())
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

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
    fn a_fault_has_priority_over_other_instructions() {
        let mut state = State::zeroed();
        state.valid = Validity::NOT_IDENTIFIED.and(Validity::GROUND_STALE).0;
        assert_eq!(reasons(&state)[0].name, "ground_stale");
        let shown = instruction(&state, None);
        assert_eq!((shown.text.as_str(), shown.tone), ("The force plate is silent", Tone::Alarm));
        assert_eq!(shown.key, "reason.ground_stale");
    }

    #[test]
    fn a_pose_is_taken_then_held() {
        let mut state = State::zeroed();
        state.phase = Phase::Identifying as u32;
        state.valid = Validity::NOT_IDENTIFIED.and(Validity::BELOW_LOAD_THRESHOLD).0;
        let shown = |state: &State| instruction(state, Some("arms out")).text;
        // Static, but in another pose: not used.
        (state.pose_mismatch_rad, state.static_pose) = (1.0, 1);
        assert_eq!(shown(&state), "Take this pose: arms out");
        (state.pose_mismatch_rad, state.static_pose) = (0.1, 0);
        assert_eq!(shown(&state), "Hold still");
        state.static_pose = 1;
        assert_eq!(shown(&state), "Good. Hold still");
        state.valid = Validity::NOT_IDENTIFIED.0;
        assert_eq!(shown(&state), "Put down what you carry");
        state.valid |= Validity::FEET_OFF_PLATE.0;
        assert_eq!(shown(&state), "Your feet are off the plate");
    }

    #[test]
    fn a_known_worker_is_asked_for_a_pose_unless_a_load_is_judged() {
        let mut state = State::zeroed();
        state.phase = Phase::Monitoring as u32;
        state.worst_joint = u32::MAX;
        state.valid = Validity::BELOW_LOAD_THRESHOLD.0;
        state.pose_mismatch_rad = 1.0;
        let shown = |state: &State| instruction(state, Some("arms out, to tell this from that")).text;
        assert_eq!(shown(&state), "Take this pose: arms out, to tell this from that");
        state.valid |= Validity::FEET_OFF_PLATE.0;
        assert_eq!(shown(&state), "Your feet are off the plate");
        state.valid = 0;
        state.worst_joint = 0;
        assert_ne!(shown(&state), "Take this pose: arms out, to tell this from that");
    }

    #[test]
    fn the_worst_joint_is_named_with_its_level() {
        let mut state = State::zeroed();
        state.phase = Phase::Monitoring as u32;
        let knee = Joint::named("RightKnee").unwrap();
        state.worst_joint = knee.index() as u32;
        for (level, shown, tone) in [
            (Level::Green, "The load on your joints is low", Tone::Good),
            (Level::Orange, "Right knee: medium load", Tone::Warn),
            (Level::Red, "Right knee: high load", Tone::Alarm),
            (Level::AboveMax, "Right knee: overloaded, put the load down", Tone::Alarm),
            (Level::Undecided, "Right knee: the load is too uncertain to evaluate", Tone::Calm),
        ] {
            state.joint_level[knee.index()] = level as u32;
            let instruction = instruction(&state, None);
            assert_eq!((instruction.text.as_str(), instruction.tone), (shown, tone));
        }
        state.valid = Validity::MOVING.0;
        assert_eq!(worst_joint(&state), None);
    }

    #[test]
    fn a_level_next_to_a_torque_is_one_word() {
        let shown = [Level::Green, Level::Orange, Level::Red, Level::AboveMax].map(|each| level(each as u32));
        assert_eq!(shown, ["low", "medium", "high", "overloaded"]);
    }

    #[test]
    fn advice_is_given_as_the_worker_stands() {
        let mut state = State { joint_level: [Level::Orange as u32; _], ..State::zeroed() };
        assert_eq!(advice(&state), None, "no direction");
        state.advice_direction = [-1.0, 0.0, 0.0];
        assert_eq!(advice(&state), None, "no heading");
        // The left hip of a worker who faces +X points along +Y.
        state.segment_origin_m[Segment::LeftUpperLeg.index()] = [0.0, 0.2, 0.9];
        assert_eq!(advice(&state), Some("Bring the load closer"));
        for (level, advised) in [
            (Level::None, false),
            (Level::Green, false),
            (Level::Orange, true),
            (Level::Red, true),
            (Level::AboveMax, false),
            (Level::Undecided, false),
        ] {
            state.joint_level = [level as u32; _];
            assert_eq!(advice(&state).is_some(), advised, "{level:?}");
        }
        state.joint_level = [Level::Red as u32; _];
        // The same direction, with the worker turned left by quarter turns.
        let turned: [([f64; 3], &str); 3] = [
            ([-0.2, 0.0, 0.9], "Move the load to your left"),
            ([0.0, -0.2, 0.9], "Move the load away from you"),
            ([0.2, 0.0, 0.9], "Move the load to your right"),
        ];
        for (left_hip, shown) in turned {
            state.segment_origin_m[Segment::LeftUpperLeg.index()] = left_hip;
            assert_eq!(advice(&state), Some(shown));
        }
        state.valid = Validity::BELOW_LOAD_THRESHOLD.0;
        assert_eq!(advice(&state), None);
    }
}
