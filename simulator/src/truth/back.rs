//! True load of the low back: inverse dynamics of everything above L5/S1, with the simulated person's own masses.

use equipoise_core::body::Segment;
use nalgebra::Vector3;

use crate::dynamics::external_wrench;
use crate::motion::{BodyState, DIFFERENCE_S, Worker};
use crate::person::Person;

/// Wrench of the pelvis on the body above L5/S1, world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BackLoad {
    /// Force, N: weight and inertia of the upper body and of the box.
    pub force_n: Vector3<f64>,
    /// Moment about L5/S1, N m. A weight in front of the joint gives a negative Y component.
    pub moment_nm: Vector3<f64>,
    /// Part of the force along the lumbar axis (the Z axis of segment L5), N; positive compresses the disc.
    pub axial_n: f64,
}

impl BackLoad {
    /// The load of the low back at a time, about a point `offset_m` (axes of segment L5) from the simulated joint: a
    /// measured joint never coincides exactly with the true one.
    pub fn of(worker: &Worker, time_s: f64, offset_m: Vector3<f64>) -> BackLoad {
        BackLoad::of_states(worker.person(), &worker.around(time_s), offset_m)
    }

    /// The same from the states one difference before, at, and one difference after a time.
    pub(super) fn of_states(person: &Person, around: &[BodyState; 3], offset_m: Vector3<f64>) -> BackLoad {
        let above = |segment: Segment| segment.is_distal_to(Segment::L5);
        let wrench = external_wrench(person, around, DIFFERENCE_S, above);
        let l5 = Segment::L5.index();
        let world_from_l5 = around[1].world_from_segment[l5];
        let joint_m = around[1].origin_m[l5] + world_from_l5 * offset_m;
        BackLoad {
            force_n: wrench.force_n,
            moment_nm: wrench.moment_nm - joint_m.cross(&wrench.force_n),
            axial_n: wrench.force_n.dot(&(world_from_l5 * Vector3::z())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GRAVITY_M_PER_S2;
    use crate::intention::Intention;
    use crate::motion::Habits;
    use crate::repertoire::LIFTING;

    const BEND: Intention =
        Intention { pelvis_deg: [30.0, 0.0, 0.0], trunk_flex_deg: 30.0, ..Intention::STAND };

    #[test]
    fn at_rest_the_moment_is_that_of_the_weights_above_the_joint() {
        let mut worker = Worker::with_habits(Person::new(3, 1.77, 72.0), 3, Habits::NONE);
        worker.intend(&BEND, 0.0, 1.0);
        worker.lift(6.0, 0.5);
        let (time_s, person) = (20.0, worker.person());
        let body = worker.sample(time_s);
        let back = BackLoad::of(&worker, time_s, Vector3::zeros());
        let joint_m = body.origin_m[Segment::L5.index()];
        let up = Vector3::z() * GRAVITY_M_PER_S2;
        let mut moment_nm = (body.load_m() - joint_m).cross(&(up * 6.0));
        for segment in Segment::ALL.into_iter().filter(|segment| *segment <= Segment::LeftHand) {
            if segment != Segment::Pelvis {
                let i = segment.index();
                moment_nm += (body.com_m[i] - joint_m).cross(&(up * person.segment_mass_kg[i]));
            }
        }
        assert!(moment_nm.norm() > 50.0 && (back.moment_nm - moment_nm).norm() < 1e-3, "{moment_nm}");
        assert!(back.axial_n > 0.0 && back.axial_n < back.force_n.norm());
        let forward_m = Vector3::new(0.01, 0.0, 0.0);
        let shifted = BackLoad::of(&worker, time_s, forward_m).moment_nm;
        let arm_m = body.world_from_segment[Segment::L5.index()] * forward_m;
        assert!((back.moment_nm - shifted - arm_m.cross(&back.force_n)).norm() < 1e-9);
    }

    #[test]
    fn in_motion_the_pelvis_and_the_legs_balance_the_ground() {
        // Newton–Euler for the pelvis and the legs alone must give the difference of both wrenches.
        let mut worker = Worker::with_habits(Person::new(3, 1.77, 72.0), 3, Habits::ORDINARY);
        for (index, intention) in [BEND, Intention::STAND, LIFTING[0]].iter().enumerate() {
            worker.intend(intention, 0.8 * index as f64, 0.8);
        }
        let mut inertial_nm = 0.0_f64;
        for time_s in [0.2, 0.6, 1.0, 1.3, 1.9] {
            let around = worker.around(time_s);
            let ground = worker.ground_reaction(time_s);
            let back = BackLoad::of(&worker, time_s, Vector3::zeros());
            let joint_m = around[1].origin_m[Segment::L5.index()];
            let mut lower = around.clone();
            lower.iter_mut().for_each(|state| state.load_kg = 0.0);
            let below = |segment: Segment| !segment.is_distal_to(Segment::L5);
            let own = external_wrench(worker.person(), &lower, DIFFERENCE_S, below);
            assert!((ground.force_n - back.force_n - own.force_n).norm() < 1e-6);
            let at_origin_nm = back.moment_nm + joint_m.cross(&back.force_n);
            assert!((ground.moment_nm - at_origin_nm - own.moment_nm).norm() < 1e-6);
            let mut still = around.clone();
            (still[0], still[2]) = (around[1].clone(), around[1].clone());
            let above = |segment: Segment| segment.is_distal_to(Segment::L5);
            let weight = external_wrench(worker.person(), &still, DIFFERENCE_S, above);
            let static_nm = weight.moment_nm - joint_m.cross(&weight.force_n);
            inertial_nm = inertial_nm.max((back.moment_nm - static_nm).xy().norm());
        }
        assert!(inertial_nm > 10.0, "the motion is quick enough to matter: {inertial_nm} N m");
    }
}
