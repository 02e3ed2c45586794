//! What the demonstration adds to the pages: the simulated human and cobot of a frame, and the last results when it ends.

use serde::Serialize;

/// The simulated human of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SimulatedHuman {
    /// Stature, m.
    pub height_m: f64,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// True mass of the box that it lifts now, kg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub box_kg: Option<f64>,
}

/// The simulated cobot of a frame, with the part at the end of the arm. Limit ratios are those of the worst joint and
/// their 1-σ.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SimulatedCobot {
    /// Base, the end of each link and the tool, station's world, m.
    pub arm_m: [[f64; 3]; 7],
    /// Mass of the part, kg.
    pub part_kg: f64,
    /// Distance between the hands on the part, m.
    pub part_width_m: f64,
    /// Published at the fixed place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub before: Option<[f64; 2]>,
    /// Published at the planned place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub after: Option<[f64; 2]>,
}

/// Published results of one lift.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LiftResult {
    /// The simulated human, with the true mass of the box.
    pub human: SimulatedHuman,
    /// Mean estimate of the load, kg.
    pub load_kg: f64,
    /// Mean 1-σ of it, kg.
    pub load_sigma_kg: f64,
    /// MVN name of the joint that came closest to its limit.
    pub joint: &'static str,
    /// Its level then.
    pub level: &'static str,
    /// Its torque then, N m.
    pub torque_nm: f64,
    /// 1-σ of it, N m.
    pub torque_sigma_nm: f64,
}
