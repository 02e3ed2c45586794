//! Each foot on its own plate, or on an insole: the ground's wrench, split. For studies without a network.
//!
//! The total wrench does not determine its distribution: the pressure point of each foot is free. It is therefore an
//! input, and the split is the one whose sum is the total wrench.

use bytemuck::Zeroable;
use equipoise_core::body::Side;
use equipoise_core::message::{Component, FootFrame, GroundDevice, GroundSample};
use nalgebra::{Vector2, Vector3};

use crate::dynamics::Wrench;
use crate::motion::Worker;
use crate::truth::feet::{Load, foot_contacts};

/// Independent noise streams of the plates.
pub const PLATE_NOISE: [&str; 2] = ["plate noise", "second plate noise"];

/// Ground reaction on the left and right foot at a time, about the world's origin; the sum is
/// [`Worker::ground_reaction`].
///
/// `press_m` is the pressure point of each foot, from its ankle along the world's axes, m, in addition to
/// [`crate::motion::BodyState::feet`]; zero is directly under the ankles.
pub fn ground_reaction_per_foot(worker: &Worker, time_s: f64, press_m: [Vector2<f64>; 2]) -> [Wrench; 2] {
    let whole = worker.ground_reaction(time_s);
    foot_contacts(&worker.sample(time_s), press_m, &whole, Load::Carried).map(|foot| {
        let force = Wrench::at(foot.force.at_m, foot.force.force_n);
        Wrench { moment_nm: force.moment_nm + foot.couple_nm, ..force }
    })
}

/// The sample of two adjacent plates on the floor (`z = 0`): the sum, and each foot separately. Times, counters and
/// sequence are left to the caller.
pub fn ground_sample(feet: &[Wrench; 2]) -> GroundSample {
    let carries = |foot: &Wrench| foot.force_n.z > 0.0;
    GroundSample {
        per_foot: 1,
        force_n: (feet[0].force_n + feet[1].force_n).into(),
        moment_nm: (feet[0].moment_nm + feet[1].moment_nm).into(),
        foot_vertical_n: [0, 1].map(|k| feet[k].force_n.z),
        foot_cop_m: [0, 1].map(|k| if carries(&feet[k]) { feet[k].cop_m().into() } else { [0.0; 2] }),
        ..GroundSample::zeroed()
    }
}

/// The sample of insoles: force on each sole and its point of action, from the middle, forward and to the left. Feet
/// are assumed flat. Times, counters and sequence are left to the caller.
pub fn insole_sample(worker: &Worker, time_s: f64, feet: &[Wrench; 2]) -> GroundSample {
    let (body, outline) = (worker.sample(time_s), worker.person().foot_outline_m);
    let middle_m = 0.5 * (outline.forward - outline.back);
    let on_sole = |side: Side| {
        let (foot, index) = (&feet[side as usize], side.foot().index());
        if foot.force_n.z <= 0.0 {
            return [0.0; 2];
        }
        let from_ankle = foot.cop_m() - body.origin_m[index].xy();
        let on_foot =
            body.world_from_segment[index].inverse() * Vector3::new(from_ankle.x, from_ankle.y, 0.0);
        [on_foot.x - middle_m, on_foot.y]
    };
    let vertical_n = [0, 1].map(|k| feet[k].force_n.z);
    GroundSample {
        per_foot: 1,
        force_n: [0.0, 0.0, vertical_n[0] + vertical_n[1]],
        foot_vertical_n: vertical_n,
        foot_cop_m: Side::BOTH.map(on_sole),
        foot_frame: FootFrame::Insole as u32,
        not_measured: Component::Shear as u32 | Component::Tilt as u32 | Component::FreeMoment as u32,
        devices: GroundDevice::Insoles as u32,
        ..GroundSample::zeroed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::person::Person;
    use equipoise_core::pose_suggestion::library::LIBRARY;

    #[test]
    fn the_parts_are_the_whole_in_motion_too() {
        let mut worker = Worker::new(Person::new(3, 1.77, 72.0), 3);
        worker.take_pose(&LIBRARY[7], 0.2, 1.5);
        worker.lift(6.0, 2.0);
        for press_m in [[Vector2::zeros(); 2], [Vector2::new(-0.02, -0.02), Vector2::new(0.1, -0.01)]] {
            for step in 1..40 {
                let time_s = 0.1 * f64::from(step);
                let whole = worker.ground_reaction(time_s);
                let feet = ground_reaction_per_foot(&worker, time_s, press_m);
                assert!((feet[0].force_n + feet[1].force_n - whole.force_n).norm() < 1e-9);
                assert!((feet[0].moment_nm + feet[1].moment_nm - whole.moment_nm).norm() < 1e-9);
                let reported = ground_sample(&feet);
                let cop_m = Vector2::from(reported.cop_m().unwrap());
                assert!((cop_m - whole.cop_m()).norm() < 1e-12);
                let by_feet: Vector2<f64> = [0, 1]
                    .map(|k| {
                        Vector2::from(reported.foot_cop_m[k]) * reported.foot_vertical_n[k]
                            / reported.force_n[2]
                    })
                    .iter()
                    .sum();
                assert!((by_feet - cop_m).norm() < 1e-12);
                assert!(reported.feet().is_some_and(|feet| feet.cop_m.is_some()));
            }
        }
    }
}
