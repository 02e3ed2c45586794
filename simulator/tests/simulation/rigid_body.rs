//! The truth's torques and ground reaction compared with those of rigid-body libraries.

use std::path::PathBuf;

use equipoise_core::body::{SEGMENTS, Side};
use equipoise_simulator::GRAVITY_M_PER_S2;
use equipoise_simulator::dynamics::ground_reaction;
use equipoise_simulator::feet::FeetDivision;
use equipoise_simulator::kinematics::{coms_m, origins_m};
use equipoise_simulator::motion::BodyState;
use equipoise_simulator::person::Person;
use equipoise_simulator::truth::{Force, overload_nm};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector2, Vector3};
use serde_json::Value;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

fn point(value: &Value) -> Vector3<f64> {
    Vector3::from_column_slice(&numbers(value))
}

#[test]
fn pinocchio_overload_of_24_cases() {
    let shared = std::env::var_os("EQUIPOISE_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")), PathBuf::from);
    let Ok(text) = std::fs::read_to_string(shared.join("golden/pinocchio_static.json")) else {
        eprintln!("skipped: no reference values under {}", shared.display());
        return;
    };
    let golden: Value = serde_json::from_str(&text).unwrap();
    let body_n = golden["mass_kg"].as_f64().unwrap() * GRAVITY_M_PER_S2;
    for (number, case) in golden["cases"].as_array().unwrap().iter().enumerate() {
        let origin: [Vector3<f64>; SEGMENTS] = std::array::from_fn(|i| point(&case["origin_m"][i]));
        let load_n = case["load_kg"].as_f64().unwrap() * GRAVITY_M_PER_S2;
        let zeta = Side::BOTH.map(|side| case["zeta"][format!("{side:?}")].as_f64().unwrap());
        let forces = |cop: &Value, vertical_n: f64| {
            let cop = Vector2::from_column_slice(&numbers(cop));
            // The cases give the fractions of the feet, and have both forces at the common centre of pressure.
            let on_foot = |k: usize| Force {
                on: Side::BOTH[k].foot(),
                at_m: cop.push(0.0),
                force_n: Vector3::z() * (zeta[k] * vertical_n),
            };
            vec![on_foot(0), on_foot(1)]
        };
        let without = forces(&case["cop_wo_m"], body_n);
        let mut with = forces(&case["cop_wt_m"], body_n + load_n);
        for side in Side::BOTH {
            let name = format!("{side:?}");
            if let Some(eta) = case["eta"][&name].as_f64() {
                let force_n = Vector3::z() * (-eta * load_n);
                with.push(Force { on: side.hand(), at_m: point(&case["hand_point_m"][&name]), force_n });
            }
        }
        for (j, torque) in overload_nm(&origin, &without, &with).iter().enumerate() {
            let expected = point(&case["delta_tau_nm"][j + 1]);
            assert!((torque - expected).norm() < 1e-6, "case {number}, joint {j}: {torque:?} {expected:?}");
        }
    }
}

/// The person of a case of `tests/golden/motion.json`.
fn person(golden: &Value, case: &Value) -> Person {
    let height_m = golden["height_m"].as_f64().unwrap();
    let segment_mass_kg: [f64; SEGMENTS] = numbers(&golden["segment_mass_kg"]).try_into().unwrap();
    let points = |key: &str| std::array::from_fn(|i| point(&golden[key][i]));
    let axes = Matrix3::from_columns(&[0, 1, 2].map(|k: usize| point(&case["inertia_axes"][k]))).transpose();
    Person {
        offset_m: points("offset_m"),
        segment_mass_kg,
        com_m: points("segment_com_m"),
        inertia_kg_m2: std::array::from_fn(|i| {
            let principal = Matrix3::from_diagonal(&point(&golden["gyration_m2"][i]));
            axes * principal * axes.transpose() * segment_mass_kg[i]
        }),
        ..Person::new(1, height_m, segment_mass_kg.iter().sum())
    }
}

fn body_state(person: &Person, case: &Value, state: &Value) -> BodyState {
    let world_from_segment = std::array::from_fn(|i| {
        let [w, x, y, z] = numbers(&state["quat"][i]).try_into().unwrap();
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
    });
    let origin_m = origins_m(person, point(&state["pelvis_m"]), &world_from_segment);
    let hand = Side::Left.hand().index();
    BodyState {
        time_s: 0.0,
        origin_m,
        world_from_segment,
        com_m: coms_m(&person.com_m, &origin_m, &world_from_segment),
        grip_m: [origin_m[hand] + world_from_segment[hand] * point(&case["grip_m"]), Vector3::zeros()],
        load_kg: case["load_kg"].as_f64().unwrap(),
        right_hand_fraction: 0.0,
        load_ahead_m: Vector3::zeros(),
        squeeze_n: Vector3::zeros(),
        feet: FeetDivision::EVEN,
        foot_stands: [true; 2],
    }
}

#[test]
fn ground_reaction_in_fast_motion_is_that_of_pinocchio_and_mujoco() {
    let golden: Value = serde_json::from_str(include_str!("../../../tests/golden/motion.json")).unwrap();
    let step_s = golden["step_s"].as_f64().unwrap();
    let cases = golden["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 6);
    for (number, case) in cases.iter().enumerate() {
        let (person, states) = (person(&golden, case), case["states"].as_array().unwrap());
        let first = states.len() / 2 - 1;
        let around = [0, 1, 2].map(|k: usize| body_state(&person, case, &states[first + k]));
        let found = ground_reaction(&person, &around, step_s);
        // Several times the truncation of second differences, which is proportional to the square of the step.
        let apart = (found.force_n - point(&case["force_n"])).amax();
        assert!(apart < 5e-3, "case {number}: {apart} N, {found:?}");
        let apart = (found.moment_nm - point(&case["moment_nm"])).amax();
        assert!(apart < 5e-3, "case {number}: {apart} N m, {found:?}");
    }
}
