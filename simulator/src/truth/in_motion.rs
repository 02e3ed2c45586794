//! Overload in motion: the torques of a motion with the box, minus those of the same motion without it.
//!
//! The body's own weight and inertia are equal in both and cancel at every joint. The remainder is the box's force on
//! the hands, `−m (a + g ẑ)` in three dimensions, and the difference of the ground's wrenches, force, shear and the
//! free moment about the vertical, each at its own centre of pressure.

use equipoise_core::body::{JOINTS, Joint};
use nalgebra::Vector3;

use super::Force;
use super::feet::{Contact, Load, NO_PRESS_M, foot_contacts};
use crate::dynamics::Wrench;
use crate::motion::BodyState;

/// Differences between the motion with and the motion without the box.
#[derive(Debug, Clone, Copy)]
pub struct Difference<'a> {
    /// The body in this motion.
    pub body: &'a BodyState,
    /// The box's forces on the hands.
    pub on_hands: &'a [Force],
    /// The ground's wrench without the box.
    pub without: Wrench,
    /// The ground's wrench with it.
    pub with: Wrench,
}

impl Difference<'_> {
    /// Torque that the box requires of each joint in this motion, world axes, N m.
    pub fn overload_nm(&self) -> [Vector3<f64>; JOINTS] {
        let hands = self.on_hands.iter().map(|force| Contact { force: *force, couple_nm: Vector3::zeros() });
        let without =
            foot_contacts(self.body, NO_PRESS_M, &self.without, Load::Removed).map(|foot| Contact {
                force: Force { force_n: -foot.force.force_n, ..foot.force },
                couple_nm: -foot.couple_nm,
            });
        let with = foot_contacts(self.body, NO_PRESS_M, &self.with, Load::Carried);
        let all: Vec<Contact> = with.into_iter().chain(hands).chain(without).collect();
        Joint::ALL.map(|joint| {
            let centre_m = self.body.origin_m[joint.segment().index()];
            let beyond = all.iter().filter(|contact| contact.force.on.is_distal_to(joint.segment()));
            -beyond
                .map(|Contact { force, couple_nm }| (force.at_m - centre_m).cross(&force.force_n) + couple_nm)
                .sum::<Vector3<f64>>()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GRAVITY_M_PER_S2;
    use crate::motion::{Habits, Worker};
    use crate::person::Person;
    use crate::realism::Realism;
    use crate::repertoire::LIFTING;
    use crate::truth::Truth;
    use equipoise_core::body::Segment;

    const BOX_KG: f64 = 8.0;

    fn lifting(habits: Habits) -> Worker {
        let mut worker = Worker::with_habits(Person::new(5, 1.80, 80.0), 5, habits);
        for (index, intention) in LIFTING.iter().enumerate() {
            worker.intend(intention, 1.0 + 2.0 * index as f64, 0.9);
        }
        worker.lift(BOX_KG, 1.5);
        worker
    }

    #[test]
    fn a_motionless_body_has_the_static_overload() {
        let habits = Habits { feet: Realism::SEVERE.habits(5).feet, load_ahead_m: 0.045, ..Habits::NONE };
        let truth = Truth::of(&lifting(habits), 20.0);
        assert!((truth.load_force_n.z + BOX_KG * GRAVITY_M_PER_S2).abs() < 1e-9);
        for joint in Joint::ALL {
            let difference =
                (truth.overload_in_motion_nm[joint.index()] - truth.overload_nm[joint.index()]).norm();
            assert!(difference < 1e-3, "{}: {difference}", joint.name());
        }
        assert!((truth.cop_without_load_in_motion_m - truth.cop_without_load_m).norm() < 1e-6);
    }

    #[test]
    fn the_pelvis_is_in_balance_in_motion() {
        // Distal to L5S1 is the box, distal to the hips the ground's reaction to it. Both moments, moved to one point,
        // must cancel: the box is a point, so its rate of angular momentum is contained in its force.
        let worker = lifting(Realism::SEVERE.habits(5));
        let mut largest_nm = 0.0_f64;
        for decisecond in 10..110 {
            let truth = Truth::of(&worker, 0.1 * f64::from(decisecond));
            let origin = |name: &str| truth.body.origin_m[Joint::named(name).unwrap().segment().index()];
            let torque = |name: &str| truth.overload_in_motion_nm[Joint::named(name).unwrap().index()];
            let pelvis_m = truth.body.origin_m[Segment::Pelvis.index()];
            let up_n = -truth.load_force_in_motion_n;
            let spine = torque("L5S1") - (origin("L5S1") - pelvis_m).cross(&-up_n);
            // Additional ground reaction, hip by hip.
            let hips = ["LeftHip", "RightHip"];
            let with = foot_contacts(&truth.body, NO_PRESS_M, &truth.ground, Load::Carried);
            let without = foot_contacts(&truth.body, NO_PRESS_M, &truth.ground_without_load, Load::Removed);
            let legs: Vector3<f64> = std::array::from_fn::<_, 2, _>(|k| {
                let more_n = with[k].force.force_n - without[k].force.force_n;
                torque(hips[k]) - (origin(hips[k]) - pelvis_m).cross(&more_n)
            })
            .iter()
            .sum();
            assert!((spine + legs).norm() < 1e-6, "{spine:?} {legs:?}");
            largest_nm = largest_nm.max(spine.norm());
        }
        assert!(largest_nm > 20.0, "nothing was lifted: {largest_nm}");
    }

    #[test]
    fn motion_matters_and_without_a_box_there_is_no_overload() {
        let mut worker = lifting(Habits::ORDINARY);
        let at_s = 3.3;
        let truth = Truth::of(&worker, at_s);
        let back = Joint::named("L5S1").unwrap().index();
        let difference = (truth.overload_in_motion_nm[back] - truth.overload_nm[back]).norm();
        assert!(difference > 0.5, "{difference}");
        worker = Worker::new(Person::new(5, 1.80, 80.0), 5);
        worker.intend(&LIFTING[2], 0.0, 0.9);
        let unloaded = Truth::of(&worker, 0.4);
        assert!(unloaded.overload_in_motion_nm.iter().all(|torque| torque.norm() < 1e-9));
    }
}
