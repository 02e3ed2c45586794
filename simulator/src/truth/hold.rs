//! The true limit ratio while a part is held at rest.

use equipoise_core::body::JOINTS;
use nalgebra::Vector3;

/// Sums over the instants of a hold.
#[derive(Debug, Clone, Copy, Default)]
pub struct TrueHold {
    torque_nm: [Vector3<f64>; JOINTS],
    limit_nm: [f64; JOINTS],
}

impl TrueHold {
    /// Adds the static overload of one instant ([`super::static_overload_nm`]) and the joints' limits along it, N m.
    pub fn add(&mut self, torque_nm: &[Vector3<f64>; JOINTS], limit_nm: &[f64; JOINTS]) {
        for joint in 0..JOINTS {
            self.torque_nm[joint] += torque_nm[joint];
            self.limit_nm[joint] += limit_nm[joint];
        }
    }

    /// Mean torque over mean limit of each joint; NaN before the first instant.
    pub fn limit_ratios(&self) -> [f64; JOINTS] {
        std::array::from_fn(|joint| self.torque_nm[joint].norm() / self.limit_nm[joint])
    }

    /// The largest of them; 0 before the first instant.
    pub fn worst(&self) -> f64 {
        self.limit_ratios().into_iter().fold(0.0, f64::max)
    }
}
