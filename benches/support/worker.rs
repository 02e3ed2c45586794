//! A worker who stands on the plate in a suit, poses, and holds a load: samples as the sensors would send them.

use bytemuck::Zeroable;
use equipoise_core::GRAVITY_M_PER_S2;
use equipoise_core::body::{Anthropometry, Segment, Sex, Side, Skeleton};
use equipoise_core::frame::{Pose, StationWorld, wxyz};
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_core::overload::sharing::project;
use equipoise_core::overload::{FootDeviation, FootLoads, Loading, LoadingSigma, Swing};
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_core::pose_suggestion::posture;
use equipoise_core::sesc::{Phi, centre_of_mass};
use nalgebra::Vector3;

/// Stature, m.
pub const HEIGHT_M: f64 = 1.77;
/// Body mass, kg.
pub const MASS_KG: f64 = 72.0;
/// Load in the hands when one is held, N.
pub const LOAD_N: f64 = 60.0;

/// The worker.
#[derive(Debug, Clone)]
pub struct Worker {
    /// Segment lengths.
    pub skeleton: Skeleton,
    /// Masses and grips: the table's, with a heavier trunk.
    pub body: Anthropometry,
    phi: Phi,
}

impl Worker {
    /// The worker of all benches.
    pub fn new() -> Worker {
        let skeleton = Skeleton::nominal(HEIGHT_M);
        let mut body = Anthropometry::de_leva(&skeleton, HEIGHT_M, Sex::Male);
        for segment in Segment::ALL.into_iter().filter(|segment| *segment <= Segment::Head) {
            body.mass_fraction[segment.index()] *= 1.1;
        }
        let sum: f64 = body.mass_fraction.iter().sum();
        body.mass_fraction = body.mass_fraction.map(|fraction| fraction / sum);
        Worker { phi: Phi::of(&skeleton, &body), skeleton, body }
    }

    /// A posture of the library (index modulo its length), the feet about the station's origin.
    pub fn pose(&self, index: usize) -> Pose<StationWorld> {
        let posture = &LIBRARY[index % LIBRARY.len()];
        let loose = posture::pose_of(posture, &self.skeleton, [0.0; 3]);
        let feet = 0.5 * (loose.origin_of(Segment::LeftFoot) + loose.origin_of(Segment::RightFoot));
        posture::pose_of(posture, &self.skeleton, (Vector3::new(0.0, 0.0, 0.1) - feet).into())
    }

    /// Grip points of the hands, m: left, right.
    pub fn grip_m(&self, pose: &Pose<StationWorld>) -> [Vector3<f64>; 2] {
        Side::BOTH.map(|side| pose.point_on(side.hand(), self.body.grip_m(side.hand())))
    }

    /// The plate's sample of this pose with `load_n` in the hands.
    pub fn ground(&self, pose: &Pose<StationWorld>, load_n: f64, time_ns: u64) -> GroundSample {
        let centre = centre_of_mass(pose, &self.phi);
        let weight_n = MASS_KG * GRAVITY_M_PER_S2;
        let [left, right] = self.grip_m(pose);
        let load = 0.5 * (left + right);
        GroundSample {
            sample_time_ns: time_ns,
            sequence: time_ns,
            force_n: [0.0, 0.0, weight_n + load_n],
            moment_nm: [centre.y * weight_n + load.y * load_n, -centre.x * weight_n - load.x * load_n, 0.0],
            ..Zeroable::zeroed()
        }
    }

    /// The suit's sample of this pose.
    pub fn suit(&self, pose: &Pose<StationWorld>, time_ns: u64) -> SuitSample {
        SuitSample {
            sample_time_ns: time_ns,
            position_m: pose.origin.map(Into::into),
            orientation_wxyz: pose.world_from_segment.map(|rotation| wxyz(&rotation)),
            ..Zeroable::zeroed()
        }
    }

    /// Eq. 15's other inputs in this pose with [`LOAD_N`], and σ of the usual size.
    pub fn loading(&self, pose: &Pose<StationWorld>) -> (Loading, LoadingSigma) {
        let centre = centre_of_mass(pose, &self.phi);
        let ground = self.ground(pose, LOAD_N, 0);
        let (vertical_n, grip_m) = (ground.force_n[2], self.grip_m(pose));
        let cop_measured_m = [-ground.moment_nm[1] / vertical_n, ground.moment_nm[0] / vertical_n];
        let cop_estimated_m = [centre.x, centre.y];
        let ankle = [Segment::LeftFoot, Segment::RightFoot].map(|foot| pose.origin_of(foot).xy().into());
        let (right, _) = project(cop_measured_m, ankle);
        let loading = Loading {
            cop_measured_m,
            cop_estimated_m,
            vertical_n,
            delta_f_n: LOAD_N,
            grip_m,
            eta: [0.5; 2],
            feet: FootLoads::Common { zeta: [1.0 - right, right] },
            deviation: FootDeviation::NONE,
            swing: Swing::NONE,
        };
        let sigma = LoadingSigma {
            cop_measured_m: 0.001,
            cop_estimated_m: [0.008; 2],
            delta_f_n: 3.0,
            eta: 0.1,
            ..LoadingSigma::EXACT
        };
        (loading, sigma)
    }
}

impl Default for Worker {
    fn default() -> Self {
        Worker::new()
    }
}
