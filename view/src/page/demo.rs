//! What the demonstration adds to the pages: the simulated human of a frame, and the last results when it ends.

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
