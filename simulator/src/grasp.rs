//! Hands on a box: both arms are moved to the sides until the grips are as far apart as the box is wide.

use equipoise_core::body::Segment;
use nalgebra::{UnitQuaternion, Vector3};

use crate::balance::grips_m;
use crate::kinematics::{down_the_tree, origins_m};
use crate::person::Person;
use crate::pose::Pose;

/// Iterations of [`hold_box`]. Their number is fixed, so that the result is a smooth function of the pose.
const ITERATIONS: usize = 4;

/// The pose with the grips `apart_m` apart.
///
/// Both arms rotate about their shoulders in the plane of the arm and the trunk's left-right axis. The middle between the
/// grips keeps its place along that axis. The result is a smooth function only of poses whose grips are less than
/// `apart_m` apart across that axis, as those of hands at a box are.
pub fn hold_box(person: &Person, pose: &Pose, apart_m: f64) -> Pose {
    let world_from_segment = down_the_tree(&pose.parent_from_segment);
    let origin_m = origins_m(person, Vector3::zeros(), &world_from_segment);
    let grips_m = grips_m(person, &origin_m, &world_from_segment);
    let leftwards = world_from_segment[Segment::T8.index()] * Vector3::y();
    let shoulders_m = UPPER_ARMS.map(|segment| origin_m[segment.index()]);
    let lateral_m = grips_m.map(|grip_m| grip_m.dot(&leftwards));
    let middle_m = 0.5 * (lateral_m[0] + lateral_m[1]);
    let mut angle_rad = [0.0; 2];
    let mut held_m = grips_m;
    for _ in 0..ITERATIONS {
        // What the grips are apart across that axis takes its part of the distance.
        let apart = held_m[0] - held_m[1];
        let across_m2 = (apart - leftwards * apart.dot(&leftwards)).norm_squared();
        let half_m = 0.5 * (apart_m * apart_m - across_m2).max(0.0).sqrt();
        for (k, target_m) in [middle_m + half_m, middle_m - half_m].into_iter().enumerate() {
            let arm_m = grips_m[k] - shoulders_m[k];
            let aside_m = arm_m.dot(&leftwards);
            let ahead_m = (arm_m - leftwards * aside_m).norm();
            let wanted_m = target_m - shoulders_m[k].dot(&leftwards);
            let left_m = (arm_m.norm_squared() - wanted_m * wanted_m).max(0.0).sqrt();
            angle_rad[k] = wanted_m.atan2(left_m) - aside_m.atan2(ahead_m);
            held_m[k] = shoulders_m[k] + turn(&arm_m, &leftwards, angle_rad[k]) * arm_m;
        }
    }
    let mut held = *pose;
    for (k, segment) in UPPER_ARMS.into_iter().enumerate() {
        let Some(parent) = segment.parent() else { continue };
        let world_from_parent = world_from_segment[parent.index()];
        let turn = turn(&(grips_m[k] - shoulders_m[k]), &leftwards, angle_rad[k]);
        let rotation = &mut held.parent_from_segment[segment.index()];
        *rotation = world_from_parent.inverse() * turn * world_from_parent * *rotation;
    }
    held
}

const UPPER_ARMS: [Segment; 2] = [Segment::LeftUpperArm, Segment::RightUpperArm];

/// Rotation of an arm towards an axis by an angle.
fn turn(arm_m: &Vector3<f64>, towards: &Vector3<f64>, angle_rad: f64) -> UnitQuaternion<f64> {
    let axis = arm_m.cross(towards).try_normalize(1e-6).unwrap_or_else(Vector3::zeros);
    UnitQuaternion::from_scaled_axis(axis * angle_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::intention::Arm;
    use crate::motion::{DIFFERENCE_S, Worker};
    use crate::realism::Realism;
    use crate::repertoire::{LIFTING, REPERTOIRE};

    /// Less than the duration of a jerk in the ground reaction's differences, s.
    const STEP_S: f64 = 2.0 * DIFFERENCE_S;

    /// Distance between the grips, m; negative if the hands are crossed.
    fn apart_m(person: &Person, pose: &Pose) -> f64 {
        let world_from_segment = down_the_tree(&pose.parent_from_segment);
        let origin_m = origins_m(person, Vector3::zeros(), &world_from_segment);
        let [left, right] = grips_m(person, &origin_m, &world_from_segment);
        let leftwards = world_from_segment[Segment::T8.index()] * Vector3::y();
        (left - right).norm().copysign((left - right).dot(&leftwards))
    }

    fn worker_of(seed: u64) -> Worker {
        let person = Person::new(seed, 1.5 + 0.0045 * seed as f64, 70.0);
        Worker::with_habits(person, seed, Realism::REALISTIC.habits(seed))
    }

    #[test]
    fn the_hands_of_any_person_come_to_be_as_far_apart_as_the_box_is_wide() {
        for seed in 0..100 {
            let worker = worker_of(seed);
            for intention in LIFTING {
                for wanted_m in [0.30, 0.38, 0.45] {
                    let pose = intention.pose();
                    let held = hold_box(worker.person(), &pose, wanted_m);
                    let error_m = apart_m(worker.person(), &held) - wanted_m;
                    assert!(error_m.abs() < 1e-6, "{seed} {intention:?}: {error_m} m");
                }
            }
        }
    }

    #[test]
    fn crossed_hands_are_separated_and_nothing_but_the_arms_is_moved() {
        let person = Person::nominal(1.77, 72.0);
        let pose = LIFTING[1].arms(Arm { outward_deg: 30.0, ..LIFTING[1].left_arm }).pose();
        assert!(apart_m(&person, &pose) < 0.0);
        let held = hold_box(&person, &pose, 0.38);
        assert!((apart_m(&person, &held) - 0.38).abs() < 1e-4);
        let changed = Segment::ALL.into_iter().filter(|segment| {
            let index = segment.index();
            held.parent_from_segment[index].angle_to(&pose.parent_from_segment[index]) > 1e-9
        });
        assert_eq!(changed.collect::<Vec<_>>(), [Segment::RightUpperArm, Segment::LeftUpperArm]);
    }

    #[test]
    fn a_carried_box_keeps_its_width_at_every_time_and_moves_smoothly() {
        for seed in (0..100).step_by(10) {
            let mut worker = worker_of(seed);
            worker.lift_and_show(8.0, 1.0);
            let wanted_m = Realism::REALISTIC.habits(seed).hands_apart_m;
            let grip_m = |time_s: f64| worker.sample(time_s).grip_m;
            for step in 0..400 {
                let body = worker.sample(0.04 * f64::from(step));
                let [left, right] = body.grip_m;
                let error_m = (left - right).norm() - wanted_m;
                assert!(body.load_kg == 0.0 || error_m.abs() < 1e-6, "{seed} {}: {error_m} m", body.time_s);
                let h = DIFFERENCE_S;
                let [before, now, after] = [-h, 0.0, h].map(|by_s| grip_m(body.time_s + by_s)[0]);
                let acceleration = (after - now * 2.0 + before) / (h * h);
                assert!(acceleration.norm() < 20.0, "{seed} {}: {acceleration:?}", body.time_s);
            }
        }
    }

    #[test]
    fn a_box_is_taken_after_any_pose_and_any_pose_after_a_box_without_a_jerk() {
        for (index, (name, intention)) in REPERTOIRE.iter().enumerate() {
            let mut worker = worker_of(index as u64);
            worker.intend(intention, 0.0, 1.8);
            worker.lift_and_show(8.0, 2.5);
            worker.intend(intention, 19.5, 1.8);
            for (from_s, to_s) in [(2.5, 4.4), (19.5, 21.4)] {
                let mut before_n = worker.ground_reaction(from_s).force_n.z;
                for step in 1..((to_s - from_s) / STEP_S) as u32 {
                    let force_n = worker.ground_reaction(from_s + STEP_S * f64::from(step)).force_n.z;
                    let by_n = (force_n - before_n).abs();
                    assert!(by_n < 20.0, "{name}, {from_s} s + {step} steps: {by_n} N");
                    before_n = force_n;
                }
            }
        }
    }
}
