//! The truth's torques compared with Pinocchio's, where its reference values are available.

use std::path::PathBuf;

use equipoise_core::body::{SEGMENTS, Side};
use equipoise_simulator::GRAVITY_M_PER_S2;
use equipoise_simulator::truth::{Force, overload_nm};
use nalgebra::{Vector2, Vector3};
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
