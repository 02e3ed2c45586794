//! Errors of torques, external force and centre of pressure, with their published σ.

use equipoise_core::body::JOINTS;
use equipoise_simulator::truth::Truth;
use nalgebra::Vector3;

use crate::tally::{Coverage, GROUPS, Sums, joints_of};

/// Errors of one kind of state: length of the torque's error, published σ and coverage by joint group, then of ΔF.
#[derive(Debug, Clone, Copy, Default)]
pub struct Errors {
    /// Length of the error by joint group, N m.
    pub error_nm: [Sums; GROUPS.len()],
    /// Published σ, N m.
    pub sigma_nm: [Sums; GROUPS.len()],
    /// Coverage of the magnitude.
    pub coverage: [Coverage; GROUPS.len()],
    /// External force, N.
    pub force_n: Scalar,
    /// Estimated centre of pressure, each axis, mm.
    pub cop_mm: Scalar,
}

/// Error of one quantity, published σ and coverage.
#[derive(Debug, Clone, Copy, Default)]
pub struct Scalar {
    /// Error.
    pub error: Sums,
    /// Published σ.
    pub sigma: Sums,
    /// Coverage of the error.
    pub coverage: Coverage,
}

impl Scalar {
    fn add(&mut self, error: f64, sigma: f64) {
        self.error.add(error);
        self.sigma.add(sigma);
        self.coverage.add(error, sigma);
    }

    fn merge(&mut self, other: &Scalar) {
        self.error.merge(&other.error);
        self.sigma.merge(&other.sigma);
        self.coverage.merge(&other.coverage);
    }
}

impl Errors {
    pub(super) fn add(&mut self, torque_nm: &[[f64; 3]; JOINTS], sigma_nm: &[f64; JOINTS], truth: &Truth) {
        for group in 0..GROUPS.len() {
            for joint in joints_of(group) {
                let (published, real) = (Vector3::from(torque_nm[joint]), truth.overload_in_motion_nm[joint]);
                self.error_nm[group].add((published - real).norm());
                self.sigma_nm[group].add(sigma_nm[joint]);
                self.coverage[group].add(published.norm() - real.norm(), sigma_nm[joint]);
            }
        }
    }

    pub(super) fn add_force(&mut self, delta_f_n: f64, sigma_n: f64, truth: &Truth) {
        self.force_n.add(delta_f_n + truth.load_force_in_motion_n.z, sigma_n);
    }

    pub(super) fn add_cop(&mut self, cop_m: [f64; 2], sigma_m: [f64; 2], truth: &Truth) {
        for axis in 0..2 {
            let error_m = cop_m[axis] - truth.cop_without_load_in_motion_m[axis];
            self.cop_mm.add(1e3 * error_m, 1e3 * sigma_m[axis]);
        }
    }

    pub(super) fn merge(&mut self, other: &Errors) {
        for group in 0..GROUPS.len() {
            self.error_nm[group].merge(&other.error_nm[group]);
            self.sigma_nm[group].merge(&other.sigma_nm[group]);
            self.coverage[group].merge(&other.coverage[group]);
        }
        self.force_n.merge(&other.force_n);
        self.cop_mm.merge(&other.cop_mm);
    }

    /// RMS over all joints of the groups, N m.
    pub fn rms_nm(&self) -> Option<f64> {
        self.all().rms()
    }

    fn all(&self) -> Sums {
        let mut all = Sums::default();
        self.error_nm.iter().for_each(|sums| all.merge(sums));
        all
    }

    /// Mean published σ over all joints of the groups, N m.
    pub fn mean_sigma_nm(&self) -> Option<f64> {
        let mut all = Sums::default();
        self.sigma_nm.iter().for_each(|sums| all.merge(sums));
        all.mean()
    }

    /// Coverage of 1 σ over all joints, %.
    pub fn covered_percent(&self) -> Option<f64> {
        Coverage::of_all(&self.coverage).percent()[0]
    }
}
