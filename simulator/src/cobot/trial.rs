//! The handovers that `equipoise demo --cobot` and `equipoise-study cobot` compare.

use nalgebra::Vector3;

/// Mass of the part, kg.
pub const PART_KG: f64 = 6.0;
/// Distance between the grips, m.
pub const WIDTH_M: f64 = 0.35;
/// The fixed place, the same for all workers, who stand at the station's origin and face X: the middle of the region that
/// `equipoise-study handover` samples, station's world, m.
pub const FIXED_M: Vector3<f64> = Vector3::new(0.45, 0.0, 1.05);
/// The part is at its place within this distance, m, …
pub const ARRIVED_M: f64 = 0.002;
/// … and its handles have their slope within this angle, rad; …
pub const TURNED_RAD: f64 = 0.01;
/// … otherwise the arm gives up after this time, s.
pub const ARRIVES_WITHIN_S: f64 = 30.0;
/// Duration of a hold with the whole weight, s.
pub const HOLD_S: f64 = 3.0;
/// From the end of a hold until the worker stands straight again, s.
pub const AFTERWARDS_S: f64 = 4.0;
