//! Torques of the legs by two plates against those by one, for simulated people who do not press under their ankles.
//!
//! What each foot would bear without the load is nobody's measurement. The rule of the core and the simulator's split
//! are alike in that, and would agree exactly; so these people press elsewhere once they carry nothing.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use equipoise_core::body::{Joint, Side};
use equipoise_core::frame::{Pose, StationWorld};
use equipoise_core::overload::{self, GRAVITY_M_PER_S2, Loading, LoadingSigma, Sharing, Swing};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::person::Person;
use equipoise_simulator::truth::{Force, Truth, ankles_m, foot_forces, overload_nm};
use equipoise_simulator::two_plates::{ground_reaction_per_foot, ground_sample};
use nalgebra::{Vector2, Vector3};

const EXACT: LoadingSigma = LoadingSigma::EXACT;
const LOAD_KG: f64 = 10.0;
const HOLDS_S: f64 = 8.0;

/// Where each foot presses, from its ankle: even, on one ball and one heel, on the outer and the inner edge.
const PRESSING: [[[f64; 2]; 2]; 3] =
    [[[0.0; 2]; 2], [[-0.02, 0.0], [0.12, 0.0]], [[0.03, 0.025], [0.05, 0.02]]];

/// How far each foot's place without the load is from that with it, m: the rule that the core goes by does not know.
const UNLOADED: [[f64; 2]; 2] = [[-0.015, 0.005], [0.01, 0.008]];

fn legs() -> impl Iterator<Item = Joint> {
    let is_leg = |joint: &Joint| ["Hip", "Knee", "Ankle"].iter().any(|name| joint.name().ends_with(name));
    Joint::ALL.into_iter().filter(is_leg)
}

/// The torques that the load really adds where the feet press like this.
fn true_nm(truth: &Truth, press_m: [Vector2<f64>; 2]) -> [Vector3<f64>; 22] {
    let body = &truth.body;
    let (load_n, body_n) = (-truth.load_force_n.z, truth.ground.force_n.z + truth.load_force_n.z);
    let ankle = ankles_m(&body.origin_m);
    let at = [0, 1].map(|k| ankle[k] + press_m[k]);
    let at_without = [0, 1].map(|k| at[k] + Vector2::from(UNLOADED[k]));
    let without = foot_forces(at_without, truth.cop_without_load_m, body_n);
    let with = foot_forces(at, truth.cop_with_load_m, body_n + load_n);
    let hands = [0, 1].map(|k| Force {
        on: Side::BOTH[k].hand(),
        at_m: body.grip_m[k],
        force_n: 0.5 * truth.load_force_n,
    });
    overload_nm(&body.origin_m, &without, &[with, hands].concat())
}

/// Root mean square error of the legs' torques by geometry and by two plates, N m.
fn errors_nm(worker: &Worker, press_m: [Vector2<f64>; 2]) -> [f64; 2] {
    let truth = Truth::of(worker, HOLDS_S);
    let told = ground_sample(&ground_reaction_per_foot(worker, HOLDS_S, press_m));
    let pose = Pose::<StationWorld>::new(truth.body.origin_m, truth.body.world_from_segment);
    let (cop_measured_m, cop_estimated_m) = (told.cop_m().unwrap(), truth.cop_without_load_m.into());
    let (vertical_n, delta_f_n) = (told.force_n[2], LOAD_KG * GRAVITY_M_PER_S2);
    let grip_m = truth.body.grip_m;
    let by_geometry =
        Sharing::from_geometry(&pose, cop_measured_m, cop_estimated_m, vertical_n, delta_f_n, &grip_m);
    let by_plates = by_geometry.with_feet(&told.feet().unwrap(), cop_measured_m);
    let expected = true_nm(&truth, press_m);
    [by_geometry, by_plates].map(|sharing| {
        let loading = Loading {
            cop_measured_m,
            cop_estimated_m,
            vertical_n,
            delta_f_n,
            grip_m,
            sharing,
            swing: Swing::NONE,
        };
        let torques = overload::torques(&pose, &loading, &EXACT);
        let square =
            |joint: Joint| (torques[joint.index()].torque_nm - expected[joint.index()]).xy().norm_squared();
        (legs().map(square).sum::<f64>() / legs().count() as f64).sqrt()
    })
}

#[test]
fn two_plates_tell_the_legs_better_than_geometry_however_the_person_stands() {
    for (index, posture) in LIBRARY.iter().enumerate().step_by(7) {
        let mut worker = Worker::with_habits(Person::new(index as u64, 1.77, 72.0), 1, Habits::NONE);
        worker.take_pose(posture, 0.0, 2.0);
        worker.lift(LOAD_KG, 4.0);
        for press_m in PRESSING {
            let [geometry_nm, plates_nm] = errors_nm(&worker, press_m.map(Vector2::from));
            println!("{:<28} {press_m:?}: {geometry_nm:.2} → {plates_nm:.2} N m", posture.name);
            assert!(plates_nm < 0.8 * geometry_nm, "{}: {geometry_nm} → {plates_nm}", posture.name);
        }
    }
}
