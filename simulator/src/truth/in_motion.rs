//! Overload while everything moves: the torques of one motion with the box, less those of the same motion without it.
//!
//! The body's own weight and inertia are the same both times and cancel at every joint. What stays is the box's force
//! on the hands, `−m (a + g ẑ)` in three dimensions, and how the ground's wrench differs, force, shear and the free
//! moment about the vertical, each at its own centre of pressure.

use equipoise_core::body::{JOINTS, Joint, SEGMENTS, Side};
use nalgebra::{Vector2, Vector3};

use super::{FootContact, Force, foot_share};
use crate::dynamics::Wrench;

/// A force on a segment with a couple.
#[derive(Debug, Clone, Copy)]
struct Contact {
    force: Force,
    couple_nm: Vector3<f64>,
}

/// What differs between the motion with and the motion without the box.
#[derive(Debug, Clone, Copy)]
pub struct Difference<'a> {
    /// Segment origins, m.
    pub origin_m: &'a [Vector3<f64>; SEGMENTS],
    /// Where the left and the right hand grip, m.
    pub grip_m: [Vector3<f64>; 2],
    /// How much of the box each carries.
    pub hand_share: [f64; 2],
    /// The box's force on both hands, N.
    pub load_force_n: Vector3<f64>,
    /// The ground's wrench without the box.
    pub without: Wrench,
    /// The ground's wrench with it.
    pub with: Wrench,
}

impl Difference<'_> {
    /// Torque that the box asks of each joint in this motion, world axes, N m.
    pub fn overload_nm(&self, contact: FootContact) -> [Vector3<f64>; JOINTS] {
        let hands = [0, 1].map(|k| Contact {
            force: Force {
                on: Side::BOTH[k].hand(),
                at_m: self.grip_m[k],
                force_n: self.load_force_n * self.hand_share[k],
            },
            couple_nm: Vector3::zeros(),
        });
        let with = self.feet(&self.with, contact).into_iter().chain(hands);
        let without = self.feet(&self.without, contact).map(|foot| Contact {
            force: Force { force_n: -foot.force.force_n, ..foot.force },
            couple_nm: -foot.couple_nm,
        });
        let all: Vec<Contact> = with.chain(without).collect();
        Joint::ALL.map(|joint| {
            let centre_m = self.origin_m[joint.segment().index()];
            let beyond = all.iter().filter(|contact| contact.force.on.is_distal_to(joint.segment()));
            -beyond
                .map(|Contact { force, couple_nm }| (force.at_m - centre_m).cross(&force.force_n) + couple_nm)
                .sum::<Vector3<f64>>()
        })
    }

    /// The ground's wrench, shared between the feet.
    fn feet(&self, ground: &Wrench, contact: FootContact) -> [Contact; 2] {
        let cop_m: Vector2<f64> = ground.cop_m();
        let free_nm = ground.moment_nm - cop_m.push(0.0).cross(&ground.force_n);
        let share = foot_share(self.origin_m, cop_m);
        let ankle = Side::BOTH.map(|side| self.origin_m[side.foot().index()].xy());
        let off_the_line = cop_m - (ankle[0] * share[0] + ankle[1] * share[1]);
        std::array::from_fn(|k| Contact {
            force: Force {
                on: Side::BOTH[k].foot(),
                at_m: match contact {
                    FootContact::UnderEachFoot => (ankle[k] + off_the_line).push(0.0),
                    FootContact::AtCentreOfPressure => cop_m.push(0.0),
                },
                force_n: ground.force_n * share[k],
            },
            couple_nm: free_nm * share[k],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GRAVITY_M_PER_S2;
    use crate::motion::{Habits, Worker};
    use crate::person::Person;
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
        let truth = Truth::of(&lifting(Habits::NONE), 20.0);
        assert!((truth.load_force_n.z + BOX_KG * GRAVITY_M_PER_S2).abs() < 1e-9);
        for (moving, still) in [
            (truth.overload_in_motion_nm, truth.overload_at_cop_nm),
            (truth.overload_in_motion_under_feet_nm, truth.overload_nm),
        ] {
            for joint in Joint::ALL {
                let difference = (moving[joint.index()] - still[joint.index()]).norm();
                assert!(difference < 1e-3, "{}: {difference}", joint.name());
            }
        }
        assert!((truth.cop_without_load_in_motion_m - truth.cop_without_load_m).norm() < 1e-6);
    }

    #[test]
    fn the_pelvis_is_in_balance_in_motion() {
        // Beyond L5S1 hangs the box, beyond the hips the ground's answer to it. Both moments, carried to one point,
        // must cancel: the box is a point, so its rate of angular momentum is all in its force.
        let worker = lifting(Habits::ORDINARY);
        let mut largest_nm = 0.0_f64;
        for decisecond in 10..110 {
            let truth = Truth::of(&worker, 0.1 * f64::from(decisecond));
            let origin = |name: &str| truth.body.origin_m[Joint::named(name).unwrap().segment().index()];
            for overload in [&truth.overload_in_motion_nm, &truth.overload_in_motion_under_feet_nm] {
                let torque = |name: &str| overload[Joint::named(name).unwrap().index()];
                let pelvis_m = truth.body.origin_m[Segment::Pelvis.index()];
                let up_n = -truth.load_force_in_motion_n;
                let spine = torque("L5S1") - (origin("L5S1") - pelvis_m).cross(&-up_n);
                // What the ground does more, hip by hip: the shares of both wrenches.
                let hips = ["LeftHip", "RightHip"];
                let legs: Vector3<f64> = std::array::from_fn::<_, 2, _>(|k| {
                    let more_n = truth.ground.force_n * foot_share(&truth.body.origin_m, truth.cop_m)[k]
                        - truth.ground_without_load.force_n
                            * foot_share(&truth.body.origin_m, truth.cop_without_load_in_motion_m)[k];
                    torque(hips[k]) - (origin(hips[k]) - pelvis_m).cross(&more_n)
                })
                .iter()
                .sum();
                assert!((spine + legs).norm() < 1e-6, "{spine:?} {legs:?}");
                largest_nm = largest_nm.max(spine.norm());
            }
        }
        assert!(largest_nm > 20.0, "nothing was lifted: {largest_nm}");
    }

    #[test]
    fn motion_matters_and_without_a_box_there_is_no_overload() {
        let mut worker = lifting(Habits::ORDINARY);
        let at_s = 3.3;
        let truth = Truth::of(&worker, at_s);
        let back = Joint::named("L5S1").unwrap().index();
        let difference = (truth.overload_in_motion_nm[back] - truth.overload_at_cop_nm[back]).norm();
        assert!(difference > 0.5, "{difference}");
        worker = Worker::new(Person::new(5, 1.80, 80.0), 5);
        worker.intend(&LIFTING[2], 0.0, 0.9);
        let unloaded = Truth::of(&worker, 0.4);
        assert!(unloaded.overload_in_motion_nm.iter().all(|torque| torque.norm() < 1e-9));
    }
}
