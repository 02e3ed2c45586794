//! What is carried, and what it does to the joints (Eq. 14, 15).

use nalgebra::Vector3;

use super::body_motion::BodyMotion;
use super::memory::Memory;
use super::settings::{Motion, Settings};
use crate::body::Side;
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::state::SharingSource;
use crate::message::{GroundSample, Validity};
use crate::motion::Moment;
use crate::overload::{self, Loading, LoadingSigma, Sharing, Swing, sharing};

/// A force is a load if it is so many σ from nothing.
const SIGMAS_OF_A_LOAD: f64 = 2.5;
/// 1-σ of where a load is in the hands, as seen from the joints: grips differ, and so do sensors on arms, m.
const GRIP_SIGMA_M: f64 = 0.02;
/// 1-σ of where a joint is above the floor, m.
const JOINT_SIGMA_M: f64 = 0.02;

impl Memory {
    /// 1-σ of the external force in this motion, N.
    pub(super) fn delta_f_sigma_n(&self) -> f64 {
        let by_motion_n = self.noise.vertical.sigma(self.noise.vertical_activity_n.height());
        math::hypot([self.ground_sigma.force_n, by_motion_n])
    }

    /// From which external force on something is carried, N.
    pub(super) fn load_limit_n(&self, settings: &Settings) -> f64 {
        match settings.motion {
            Motion::Paper => settings.load_threshold_n,
            Motion::Compensated { .. } => {
                settings.load_threshold_n.max(SIGMAS_OF_A_LOAD * self.delta_f_sigma_n())
            }
        }
    }

    /// Eq. 14 and 15; `feet` where each was measured by itself.
    pub(super) fn overload(
        &mut self,
        pose: &Pose<StationWorld>,
        body: &BodyMotion,
        moment: &Moment,
        settings: &Settings,
        found: &mut Validity,
    ) {
        let feet = moment.ground().and_then(GroundSample::feet);
        let worker = &self.identification;
        let vertical_n = self.known.ground_force_n[2];
        let delta_f_n = vertical_n - worker.mass_kg * body.specific_force_m_per_s2 - self.terms.force_n[2];
        self.known.delta_f_n = [0.0, 0.0, delta_f_n];
        self.known.delta_f_sigma_n = self.delta_f_sigma_n();
        let loaded = delta_f_n.abs() >= self.load_limit_n(settings);
        found.raise(Validity::BELOW_LOAD_THRESHOLD, !loaded);
        // In quick motion a load may hide below what can be told: then nothing is known of it.
        let is_hidden = self.load_limit_n(settings) > settings.load_threshold_n && !self.unloaded.is_quiet();
        found.raise(Validity::LOAD_MAY_HIDE, !loaded && is_hidden);
        if !loaded
            || !worker.has_body()
            || found.any_of(Validity::FEET_OFF_PLATE.and(Validity::COP_NOT_MEASURED))
        {
            return;
        }
        let table = worker.anthropometry();
        let grip_m: [Vector3<f64>; 2] =
            Side::BOTH.map(|side| pose.point_on(side.hand(), table.grip_m(side.hand())));
        let (cop_measured_m, cop_estimated_m) = (self.known.cop_measured_m, self.known.cop_estimated_m);
        let by_geometry =
            Sharing::from_geometry(pose, cop_measured_m, cop_estimated_m, vertical_n, delta_f_n, &grip_m);
        let (sharing, source, zeta_sigma) = match feet {
            Some(feet) => {
                let sigma = (self.ground_sigma.force_n / vertical_n).min(0.5);
                (by_geometry.with_feet(&feet, cop_measured_m), SharingSource::Measured, sigma)
            }
            None => (by_geometry, SharingSource::Geometry, Sharing::zeta_sigma_by_geometry(pose)),
        };
        // The load's place is known as well as the two centres of pressure, magnified by weight over load.
        let place_sigma_m = self.known.cop_sigma_m.iter().copied().fold(0.0, f64::max)
            * (vertical_n - delta_f_n)
            / delta_f_n.abs();
        let between_hands_m = (grip_m[0] - grip_m[1]).xy().norm();
        let eta_sigma = place_sigma_m / between_hands_m.max(1e-3);
        let (sharing, eta_sigma, swing_n) = if settings.motion == Motion::Paper {
            (sharing.as_in_the_paper(), eta_sigma.min(0.5), [0.0; 2])
        } else {
            let (sharing, eta_sigma) = sharing.with_both_hands(eta_sigma);
            let load_kg = body.load_kg(delta_f_n);
            let [x, y, _] = body.hands_acceleration_m_per_s2();
            (sharing, eta_sigma, [load_kg * x, load_kg * y])
        };
        let loading = Loading {
            cop_measured_m,
            cop_estimated_m,
            vertical_n,
            delta_f_n,
            grip_m,
            sharing,
            swing: Swing { force_n: swing_n, surface_z_m: moment.ground.surface_z_m },
        };
        let sigma = LoadingSigma {
            cop_measured_m: self.ground_sigma.cop_m,
            cop_estimated_m: self.known.cop_sigma_m,
            delta_f_n: self.known.delta_f_sigma_n,
            eta: eta_sigma,
            zeta: zeta_sigma,
            foot_without_load_m: if feet.is_some() { sharing::FOOT_WITHOUT_LOAD_SIGMA_M } else { 0.0 },
            grip_m: GRIP_SIGMA_M,
            joint_m: JOINT_SIGMA_M,
        };
        found.raise(
            Validity::LOAD_NOT_AT_HANDS,
            sharing.load_distance_m > settings.load_distance_max_m + 2.0 * place_sigma_m,
        );
        self.known.zeta = sharing.zeta;
        self.known.sharing_source = source as u32;
        self.known.eta = sharing.eta;
        self.known.load_distance_m = sharing.load_distance_m;
        for (joint, torque) in overload::torques(pose, &loading, &sigma).into_iter().enumerate() {
            self.known.torque_nm[joint] = torque.torque_nm.into();
            self.known.torque_sigma_nm[joint] = torque.sigma_nm;
        }
    }
}
