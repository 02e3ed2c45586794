//! The joint of the headline, for the worker's page, the terminal and the page of several stations.

use equipoise_core::body::Joint;
use equipoise_core::message::State;
use equipoise_core::overload::Level;

use super::{torque_nm, worst_joint};
use crate::levels::severity;

/// The overload of one joint. A limit or σ that is unavailable is infinite.
#[derive(Debug, Clone, Copy)]
pub struct JointLoad {
    /// The published level.
    pub level: Level,
    /// Magnitude of the overload torque, N m.
    pub torque_nm: f64,
    /// Its 1-σ, N m.
    pub sigma_nm: f64,
    /// The joint's limit, N m.
    pub limit_nm: f64,
}

impl JointLoad {
    /// The level that the joint has at least: of an undecided one that of its torque − σ, if that is orange or higher.
    fn certain_level(&self) -> Level {
        match self.level {
            Level::Undecided => match Level::of((self.torque_nm - self.sigma_nm).max(0.0), self.limit_nm) {
                Level::Green => Level::Undecided,
                level => level,
            },
            decided => decided,
        }
    }
}

/// Selects the joint of the headline, with its certain level: the highest level, where undecided precedes green; among
/// equal levels the joint closest to its limit, and `worst` among equal distances.
pub fn headline_of<T: PartialEq>(
    worst: &T,
    joints: impl Iterator<Item = (T, JointLoad)>,
) -> Option<(T, Level)> {
    let order = |joint: &T, load: &JointLoad| {
        (severity(load.certain_level()), load.torque_nm / load.limit_nm, joint == worst)
    };
    joints
        .max_by(|(a, a_load), (b, b_load)| {
            let ((a_level, a_ratio, a_worst), (b_level, b_ratio, b_worst)) =
                (order(a, a_load), order(b, b_load));
            a_level.cmp(&b_level).then(a_ratio.total_cmp(&b_ratio)).then(a_worst.cmp(&b_worst))
        })
        .map(|(joint, load)| (joint, load.certain_level()))
}

/// The joint of the headline and its certain level; `None` while torques are withheld.
pub fn headline_joint(state: &State) -> Option<(Joint, Level)> {
    let worst = worst_joint(state)?;
    let load = |joint: Joint| {
        let limit_nm = state.torque_limit_nm[joint.index()];
        JointLoad {
            level: Level::from_number(state.joint_level[joint.index()]).unwrap_or(Level::None),
            torque_nm: torque_nm(state, joint),
            sigma_nm: state.torque_sigma_nm[joint.index()],
            limit_nm: if limit_nm > 0.0 { limit_nm } else { f64::INFINITY },
        }
    };
    headline_of(&worst, Joint::ALL.into_iter().map(|joint| (joint, load(joint))))
}

#[cfg(test)]
mod tests {
    use super::super::{Tone, advice, instruction};
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::body::Segment;
    use equipoise_core::message::state::Phase;

    /// A state with these torques, σ and levels, and limits of 100 N m; the first joint is the worst one. The worker
    /// faces +X, and the load is to be brought closer.
    fn state(joints: &[(&str, f64, f64, Level)]) -> State {
        let mut state = State { phase: Phase::Monitoring as u32, ..State::zeroed() };
        state.advice_direction = [-1.0, 0.0, 0.0];
        state.segment_origin_m[Segment::LeftUpperLeg.index()] = [0.0, 0.2, 0.9];
        state.worst_joint = Joint::named(joints[0].0).unwrap().index() as u32;
        for (name, torque_nm, sigma_nm, level) in joints {
            let index = Joint::named(name).unwrap().index();
            state.torque_nm[index][0] = *torque_nm;
            state.torque_sigma_nm[index] = *sigma_nm;
            state.torque_limit_nm[index] = 100.0;
            state.joint_level[index] = *level as u32;
        }
        state
    }

    fn shown(joints: &[(&str, f64, f64, Level)]) -> (String, Tone, bool) {
        let state = state(joints);
        let shown = instruction(&state, None);
        (shown.text, shown.tone, advice(&state).is_some())
    }

    #[test]
    fn the_headline_is_not_green_while_a_joint_is_undecided() {
        let hip = ("LeftHip", 20.0, 12.0, Level::Undecided);
        let elbow = ("LeftElbow", 25.0, 8.0, Level::Undecided);
        let text = "Left elbow: the load is too uncertain to evaluate".to_owned();
        assert_eq!(shown(&[("RightKnee", 28.0, 1.0, Level::Green), elbow, hip]), (text, Tone::Calm, false));
        let text = "Right knee: medium load".to_owned();
        assert_eq!(shown(&[("RightKnee", 35.0, 1.0, Level::Orange), elbow, hip]), (text, Tone::Warn, true));
    }

    #[test]
    fn an_undecided_joint_has_at_least_its_certain_level() {
        for (torque_nm, sigma_nm, text, tone, advised) in [
            (105.0, 8.0, "Right knee: high load", Tone::Alarm, true),
            (62.0, 5.0, "Right knee: medium load", Tone::Warn, true),
            (140.0, 30.0, "Right knee: overloaded, put the load down", Tone::Alarm, false),
            (80.0, 55.0, "Right knee: the load is too uncertain to evaluate", Tone::Calm, false),
        ] {
            let joints = [("RightKnee", torque_nm, sigma_nm, Level::Undecided)];
            assert_eq!(shown(&joints), (text.to_owned(), tone, advised));
        }
    }

    #[test]
    fn an_undecided_joint_does_not_mask_a_higher_level() {
        let elbow = ("LeftElbow", 79.0, 1.0, Level::Red);
        for sigma_nm in [30.0, 60.0] {
            let joints = [("RightKnee", 80.0, sigma_nm, Level::Undecided), elbow];
            // The advice is that of the knee.
            assert_eq!(shown(&joints), ("Left elbow: high load".to_owned(), Tone::Alarm, false));
        }
    }

    #[test]
    fn a_joint_without_limit_does_not_precede_the_worst_one() {
        let mut state = state(&[("RightKnee", 10.0, 1.0, Level::None)]);
        state.torque_nm[Joint::named("LeftHip").unwrap().index()][0] = 50.0;
        assert_eq!(headline_joint(&state).map(|(joint, _)| joint.name()), Some("RightKnee"));
        state.valid = equipoise_core::message::Validity::MOVING.0;
        assert_eq!(headline_joint(&state), None);
    }
}
