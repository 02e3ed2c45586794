//! The boxes of the demonstration: how each is lifted, and what is measured meanwhile.

use equipoise_core::body::Joint;
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;
use equipoise_simulator::intention::{Arm, Intention};
use equipoise_simulator::repertoire::LIFTING;
use equipoise_simulator::simulation::SimulationHandle;
use equipoise_simulator::truth::Truth;
use nalgebra::Vector3;

/// The boxes in turn, kg. Carried low and stretched out, they reach all levels.
pub(super) const BOXES_KG: [f64; 3] = [4.0, 10.0, 16.0];
/// The joints of the paper's Fig. 6 and the lower back: label and MVN name.
pub(super) const JOINTS_SHOWN: [(&str, &str); 6] = [
    ("hip", "RightHip"),
    ("knee", "RightKnee"),
    ("ankle", "RightAnkle"),
    ("shoulder", "RightShoulder"),
    ("elbow", "RightElbow"),
    ("lower_back", "L5S1"),
];
/// Duration of a change of posture, s.
const CHANGE_S: f64 = 1.8;
/// The load is complete in the hands from this fraction of the box on; less while it is grasped.
const GRASPED: f64 = 0.999;

/// Part of a lift.
#[derive(Debug, Clone, Copy)]
enum Act {
    Posture(Intention),
    Grasp,
    Release,
}

/// The arms hang, so that the wrists, whose limits are lowest, carry the box with a short lever.
const CARRY_LOW: Intention =
    Intention::STAND.at_box(Arm { elevation_deg: 8.0, forward_deg: 85.0, outward_deg: 63.0, elbow_deg: 5.0 });

/// When each part of a lift begins, s: reach for the box, take it, carry it low, stretch it out, set it back.
const ACTS: [(f64, Act); 6] = [
    (0.0, Act::Posture(LIFTING[0])),
    (2.0, Act::Grasp),
    (2.6, Act::Posture(CARRY_LOW)),
    (5.2, Act::Posture(LIFTING[2])),
    (7.8, Act::Posture(LIFTING[4])),
    (9.8, Act::Release),
];
/// Duration of a lift, s. The next one begins with empty hands for two seconds.
pub(super) const LIFT_S: f64 = 11.0;

/// Carries out what is due `since_s` after the start of a lift of this mass, or of the same motion with empty hands;
/// `done` parts are complete already. Returns their new number.
pub(super) fn act(
    person: &SimulationHandle,
    mass_kg: Option<f64>,
    since_s: f64,
    pace: f64,
    done: usize,
) -> usize {
    let due = |(at_s, _): &&(f64, Act)| at_s * pace <= since_s;
    for (_, act) in ACTS.iter().skip(done).take_while(due) {
        match *act {
            Act::Posture(intention) => person.intend(&intention, CHANGE_S),
            Act::Grasp => {
                if let Some(mass_kg) = mass_kg {
                    person.lift(mass_kg);
                }
            }
            Act::Release => person.put_down(),
        }
    }
    ACTS.iter().take_while(due).count().max(done)
}

/// Sums for one joint during a lift.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct JointSums {
    pub(super) published_nm: f64,
    pub(super) true_nm: f64,
    pub(super) error_nm2: f64,
    pub(super) sigma_nm: f64,
    pub(super) true_max_nm: f64,
    pub(super) published_max_nm: f64,
}

/// Sums of the load's mass, kg, over the samples in which it is published and the box is completely in the hands.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MassSums {
    pub(super) samples: f64,
    pub(super) published_kg: f64,
    pub(super) sigma_kg: f64,
    pub(super) true_kg: f64,
}

/// The instant at which a joint came closest to its limit with a decided level.
#[derive(Debug, Clone, Copy)]
pub(super) struct Peak {
    pub(super) joint: Joint,
    pub(super) level: Level,
    pub(super) torque_nm: f64,
    pub(super) sigma_nm: f64,
    pub(super) true_nm: f64,
    pub(super) limit_nm: f64,
}

impl Peak {
    fn limit_ratio(&self) -> f64 {
        self.torque_nm / self.limit_nm
    }
}

/// What was measured during one lift.
#[derive(Debug, Clone)]
pub(super) struct LiftSums {
    /// Suit samples with valid torques.
    pub(super) samples: f64,
    pub(super) delta_f_n: f64,
    pub(super) delta_f_sigma_n: f64,
    pub(super) delta_f_true_n: f64,
    pub(super) mass: MassSums,
    pub(super) joints: [JointSums; JOINTS_SHOWN.len()],
    /// For each level, samples in which a joint has it.
    pub(super) levels: Vec<(Level, u64)>,
    pub(super) peak: Option<Peak>,
}

impl LiftSums {
    pub(super) fn new() -> LiftSums {
        let levels = [Level::Green, Level::Orange, Level::Red, Level::AboveMax, Level::Undecided];
        LiftSums {
            samples: 0.0,
            delta_f_n: 0.0,
            delta_f_sigma_n: 0.0,
            delta_f_true_n: 0.0,
            mass: MassSums::default(),
            joints: [JointSums::default(); JOINTS_SHOWN.len()],
            levels: levels.map(|level| (level, 0)).to_vec(),
            peak: None,
        }
    }

    /// Whether torques and the mass were published with the box in the hands.
    pub(super) fn is_complete(&self) -> bool {
        self.mass.samples > 0.0
    }

    /// Adds a state with valid torques and the truth of the same instant.
    pub(super) fn add(&mut self, state: &State, truth: &Truth, box_kg: f64) {
        self.samples += 1.0;
        self.delta_f_n += state.delta_f_n[2];
        self.delta_f_sigma_n += state.delta_f_sigma_n;
        self.delta_f_true_n -= truth.load_force_in_motion_n.z;
        for (sums, (_, name)) in self.joints.iter_mut().zip(JOINTS_SHOWN) {
            let Some(joint) = Joint::named(name).map(Joint::index) else { continue };
            let published = Vector3::from(state.torque_nm[joint]);
            // The published torque includes motion, so compare it with the true torque in motion, where the force of
            // each foot acts at its own pressure point.
            let real = truth.overload_in_motion_nm[joint];
            sums.published_nm += published.norm();
            sums.true_nm += real.norm();
            sums.published_max_nm = sums.published_max_nm.max(published.norm());
            sums.true_max_nm = sums.true_max_nm.max(real.norm());
            sums.error_nm2 += (published - real).norm_squared();
            sums.sigma_nm += state.torque_sigma_nm[joint];
        }
        let grasped = truth.body.load_kg > GRASPED * box_kg;
        if grasped && !state.validity().any_of(Validity::INVALIDATES_LIFTED_MASS) {
            self.mass.samples += 1.0;
            self.mass.published_kg += state.lifted_mass_kg;
            self.mass.sigma_kg += state.lifted_mass_sigma_kg;
            self.mass.true_kg += truth.body.load_kg;
        }
        self.add_level(state, truth);
    }

    fn add_level(&mut self, state: &State, truth: &Truth) {
        for (level, samples) in &mut self.levels {
            *samples += u64::from(state.joint_level.contains(&(*level as u32)));
        }
        let index = state.worst_joint as usize;
        let Some(joint) = Joint::ALL.get(index).copied() else { return };
        let Some(level) = Level::from_number(state.joint_level[index]) else { return };
        let peak = Peak {
            joint,
            level,
            torque_nm: Vector3::from(state.torque_nm[index]).norm(),
            sigma_nm: state.torque_sigma_nm[index],
            true_nm: truth.overload_in_motion_nm[index].norm(),
            limit_nm: state.torque_limit_nm[index],
        };
        let is_decided = !matches!(level, Level::None | Level::Undecided);
        if is_decided && self.peak.is_none_or(|highest| peak.limit_ratio() > highest.limit_ratio()) {
            self.peak = Some(peak);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_posture_of_a_lift_holds_the_box() {
        for (at_s, act) in ACTS {
            assert!(!matches!(act, Act::Posture(Intention { at_box: false, .. })), "{at_s} s: {act:?}");
        }
    }
}
