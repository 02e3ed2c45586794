//! The dense textbook method with nalgebra, as in a first version.
//!
//! Sizes are compile-time constants and nothing is on the heap, which is the fastest that nalgebra can do here.

use equipoise_core::body::{JOINTS, Joint, SEGMENTS, Segment, Side};
use equipoise_core::frame::{Pose, StationWorld};
use equipoise_core::overload::{FootLoads, Loading};
use equipoise_core::sesc::{PARAMETERS, Phi};
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// Columns of a Jacobian: three rotations a joint.
pub const COLUMNS: usize = 3 * JOINTS;

/// B of Eq. 3, 3×69: the segments' rotations side by side.
pub type ChainMatrix = SMatrix<f64, 3, PARAMETERS>;

/// State and covariance of N parameters.
#[derive(Debug, Clone)]
pub struct DenseFilter<const N: usize> {
    /// θ, m.
    pub theta_m: SVector<f64, N>,
    /// P, m².
    pub covariance_m2: SMatrix<f64, N, N>,
}

impl<const N: usize> DenseFilter<N> {
    /// No prior: θ = 0, P = variance · 1.
    pub fn new(variance_m2: f64) -> Self {
        DenseFilter { theta_m: SVector::zeros(), covariance_m2: SMatrix::from_diagonal_element(variance_m2) }
    }

    /// Eq. 7.
    pub fn predict(&mut self, variance_m2: f64) {
        for index in 0..N {
            self.covariance_m2[(index, index)] += variance_m2;
        }
    }

    /// `P⁺ = (1 − K H) P (1 − K H)ᵀ + K R Kᵀ` with two rows (m) of equal variance.
    pub fn update_joseph(&mut self, h: &SMatrix<f64, 2, N>, z_m: &Vector2<f64>, r_m2: f64) {
        let (_, gain) = self.gain(h, r_m2);
        self.theta_m += gain * (z_m - h * self.theta_m);
        let left = SMatrix::<f64, N, N>::identity() - gain * h;
        self.covariance_m2 = left * self.covariance_m2 * left.transpose()
            + gain * (Matrix2::identity() * r_m2) * gain.transpose();
    }

    /// `P⁺ = P − K (P Hᵀ)ᵀ` with two rows (m) of equal variance.
    pub fn update_gain_form(&mut self, h: &SMatrix<f64, 2, N>, z_m: &Vector2<f64>, r_m2: f64) {
        let (spread, gain) = self.gain(h, r_m2);
        self.theta_m += gain * (z_m - h * self.theta_m);
        self.covariance_m2 -= gain * spread.transpose();
    }

    /// `P Hᵀ` and K.
    fn gain(&self, h: &SMatrix<f64, 2, N>, r_m2: f64) -> (SMatrix<f64, N, 2>, SMatrix<f64, N, 2>) {
        let spread = self.covariance_m2 * h.transpose();
        let innovation = h * spread + Matrix2::identity() * r_m2;
        let inverse = innovation.try_inverse().expect("a measurement with noise has an invertible S");
        (spread, spread * inverse)
    }
}

/// B for a pose.
pub fn chain_matrix(pose: &Pose<StationWorld>) -> ChainMatrix {
    let mut chain = ChainMatrix::zeros();
    for (segment, rotation) in pose.world_from_segment.iter().enumerate() {
        chain.fixed_view_mut::<3, 3>(0, 3 * segment).copy_from(rotation.to_rotation_matrix().matrix());
    }
    chain
}

/// `x0 + B Φ`, m.
pub fn centre_of_mass(pose: &Pose<StationWorld>, chain: &ChainMatrix, phi: &Phi) -> Vector3<f64> {
    let phi = SVector::<f64, PARAMETERS>::from_fn(|raw, _| phi.0[raw / 3][raw % 3]);
    pose.origin_of(Segment::Pelvis) + chain * phi
}

/// The 3×66 Jacobian of a point (m) that moves with `end`: for each joint proximal to it, `−[point − o_j]×`.
fn jacobian(pose: &Pose<StationWorld>, end: Segment, point_m: Vector3<f64>) -> SMatrix<f64, 3, COLUMNS> {
    let mut jacobian = SMatrix::<f64, 3, COLUMNS>::zeros();
    for joint in Joint::ALL.into_iter().filter(|joint| end.is_distal_to(joint.segment())) {
        let arm_m = point_m - pose.origin_of(joint.segment());
        let block: Matrix3<f64> = -arm_m.cross_matrix();
        jacobian.fixed_view_mut::<3, 3>(0, 3 * joint.index()).copy_from(&block);
    }
    jacobian
}

/// Eq. 15 as written, without the σ that the core adds; N m, world axes:
/// `Δτ = Σ_h η_h J_hᵀ ΔF − Σ_k ζ_k [Ĵ_kᵀ ΔF + (J_k − Ĵ_k)ᵀ f_wt]`.
pub fn torques(pose: &Pose<StationWorld>, loading: &Loading) -> [Vector3<f64>; JOINTS] {
    let delta_f = Vector3::new(0.0, 0.0, loading.delta_f_n);
    let ground = Vector3::new(0.0, 0.0, loading.vertical_n);
    let on_ground = |[x, y]: [f64; 2]| Vector3::new(x, y, 0.0);
    let FootLoads::Common { zeta } = loading.feet else { panic!("Eq. 15 has common centres of pressure") };
    let mut sum = SVector::<f64, COLUMNS>::zeros();
    for (index, side) in Side::BOTH.into_iter().enumerate() {
        let hand = jacobian(pose, side.hand(), loading.grip_m[index]);
        let measured = jacobian(pose, side.foot(), on_ground(loading.cop_measured_m));
        let estimated = jacobian(pose, side.foot(), on_ground(loading.cop_estimated_m));
        sum += hand.transpose() * delta_f * loading.eta[index];
        sum -= (estimated.transpose() * delta_f + (measured - estimated).transpose() * ground) * zeta[index];
    }
    std::array::from_fn(|joint| sum.fixed_rows::<3>(3 * joint).into_owned())
}

const _: () = assert!(PARAMETERS == 3 * SEGMENTS, "B has three columns a segment");
