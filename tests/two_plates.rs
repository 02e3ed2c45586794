//! Torques of the legs by two plates against those by one, for simulated people who do not press under their ankles.
//!
//! The load of each foot without the carried load is not measurable. The core's rule is the mean of the simulator's split
//! and would agree exactly with people without deviations; so these people press elsewhere once they carry nothing.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use equipoise_core::GRAVITY_M_PER_S2;
use equipoise_core::body::{Joint, Side};
use equipoise_core::frame::{Pose, StationWorld};
use equipoise_core::overload::{self, FootDeviation, FootLoads, Loading, LoadingSigma, Swing};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::person::Person;
use equipoise_simulator::truth::feet::{Load, foot_forces};
use equipoise_simulator::truth::{Force, Truth, overload_nm};
use equipoise_simulator::two_plates::{ground_reaction_per_foot, ground_sample};
use nalgebra::{Vector2, Vector3};

const EXACT: LoadingSigma = LoadingSigma::EXACT;
const LOAD_KG: f64 = 10.0;
const HOLDS_S: f64 = 8.0;

/// Pressure point of each foot, from its ankle: level, on one ball and one heel, on the outer and the inner edge.
const PRESSING: [[[f64; 2]; 2]; 3] =
    [[[0.0; 2]; 2], [[-0.02, 0.0], [0.12, 0.0]], [[0.03, 0.025], [0.05, 0.02]]];

/// Distance of each foot's unloaded pressure point from the loaded one, m: the core's rule does not model it.
const UNLOADED: [[[f64; 2]; 2]; 4] = [
    [[-0.015, 0.005], [0.01, 0.008]],
    [[0.015, -0.005], [-0.01, -0.008]],
    [[0.01, 0.008], [0.015, -0.005]],
    [[-0.01, -0.008], [-0.015, 0.005]],
];

fn legs() -> impl Iterator<Item = Joint> {
    let is_leg = |joint: &Joint| ["Hip", "Knee", "Ankle"].iter().any(|name| joint.name().ends_with(name));
    Joint::ALL.into_iter().filter(is_leg)
}

/// The torques that the load really adds with these pressure points.
fn true_nm(truth: &Truth, press_m: [Vector2<f64>; 2], unloaded: [[f64; 2]; 2]) -> [Vector3<f64>; 22] {
    let body = &truth.body;
    let (load_n, body_n) = (-truth.load_force_n.z, truth.ground.force_n.z + truth.load_force_n.z);
    let press_without_m = [0, 1].map(|k| press_m[k] + Vector2::from(unloaded[k]));
    let without = foot_forces(body, press_without_m, truth.cop_without_load_m, body_n, Load::Removed);
    let with = foot_forces(body, press_m, truth.cop_with_load_m, body_n + load_n, Load::Carried);
    let hands = [0, 1].map(|k| Force {
        on: Side::BOTH[k].hand(),
        at_m: body.grip_m[k],
        force_n: 0.5 * truth.load_force_n,
    });
    overload_nm(&body.origin_m, &without, &[with, hands].concat())
}

/// Root mean square error of the legs' torques by geometry and by two plates, N m.
fn errors_nm(worker: &Worker, press_m: [Vector2<f64>; 2], unloaded: [[f64; 2]; 2]) -> [f64; 2] {
    let truth = Truth::of(worker, HOLDS_S);
    let measured = ground_sample(&ground_reaction_per_foot(worker, HOLDS_S, press_m));
    let pose = Pose::<StationWorld>::new(truth.body.origin_m, truth.body.world_from_segment);
    let (cop_measured_m, cop_estimated_m) = (measured.cop_m().unwrap(), truth.cop_without_load_m.into());
    let (vertical_n, delta_f_n) = (measured.force_n[2], LOAD_KG * GRAVITY_M_PER_S2);
    let grip_m = truth.body.grip_m;
    let by_geometry = FootLoads::Geometry { press_m: [[0.0; 2]; 2], stands: [true; 2] };
    let by_plates = FootLoads::measured(&measured.feet().unwrap(), cop_measured_m);
    let expected = true_nm(&truth, press_m, unloaded);
    [by_geometry, by_plates].map(|feet| {
        let loading = Loading {
            cop_measured_m,
            cop_estimated_m,
            vertical_n,
            delta_f_n,
            grip_m,
            eta: [0.5; 2],
            feet,
            deviation: FootDeviation::NONE,
            swing: Swing::NONE,
        };
        let torques = overload::torques(&pose, &loading, &EXACT);
        let square =
            |joint: Joint| (torques[joint.index()].torque_nm - expected[joint.index()]).xy().norm_squared();
        (legs().map(square).sum::<f64>() / legs().count() as f64).sqrt()
    })
}

#[test]
fn two_plates_give_better_torques_of_the_legs_than_geometry_for_feet_that_press_unevenly() {
    let (mut square_nm2, mut count) = ([0.0; 2], 0.0);
    for (index, posture) in LIBRARY.iter().enumerate().step_by(7) {
        let mut worker = Worker::with_habits(Person::new(index as u64, 1.77, 72.0), 1, Habits::NONE);
        worker.take_pose(posture, 0.0, 2.0);
        worker.lift(LOAD_KG, 4.0);
        for press_m in PRESSING {
            for unloaded in UNLOADED {
                let errors_nm = errors_nm(&worker, press_m.map(Vector2::from), unloaded);
                for (sum, error_nm) in square_nm2.iter_mut().zip(errors_nm) {
                    *sum += error_nm * error_nm;
                }
                count += 1.0;
                if press_m == PRESSING[0] {
                    let [geometry_nm, plates_nm] = errors_nm;
                    assert!((geometry_nm - plates_nm).abs() < 1e-6, "feet that press evenly: {errors_nm:?}");
                }
            }
        }
    }
    let [geometry_nm, plates_nm] = square_nm2.map(|sum| f64::sqrt(sum / count));
    println!("one plate {geometry_nm:.2} N m, two plates {plates_nm:.2} N m");
    assert!(plates_nm < 0.95 * geometry_nm, "one plate {geometry_nm} N m, two plates {plates_nm} N m");
}
