//! What one aligned sample says: where the body is, whether it holds still, what the load does to the joints.

use nalgebra::Vector3;

use super::alignment::Aligned;
use super::memory::Memory;
use super::settings::Settings;
use super::{CLOCK_SIGMA_MAX_NS, NO_POSE, support};
use crate::anchor::STANCE_SIGMA_M;
use crate::body::{JOINTS, Side};
use crate::frame::{Pose, StationWorld, wxyz};
use crate::math;
use crate::message::ground::{Feet, NoCop};
use crate::message::state::SharingSource;
use crate::message::{GroundSample, State, Validity};
use crate::overload::{self, GRAVITY_M_PER_S2, Level, Loading, LoadingSigma, Sharing, sharing};
use crate::sesc::centre_of_mass;
use crate::static_pose::{Held, Stillness, rms_joint_angle};

/// Within this multiple of the stillness thresholds the static equations are good enough to publish torques.
const NEARLY_STILL: f64 = 3.0;
/// What a plate may show that is taken for a worker's mass, kg.
const BODY_MASS_KG: core::ops::RangeInclusive<f64> = 25.0..=250.0;
/// The CoP may lie this far outside the modelled soles, m.
const SUPPORT_MARGIN_M: f64 = 0.02;

impl Memory {
    /// Works through one aligned sample.
    pub(super) fn monitor(&mut self, settings: &Settings, aligned: &Aligned) {
        let suit = &aligned.suit;
        let in_suit_world = suit.pose();
        self.identification.learn_skeleton(&in_suit_world, settings);
        let pose = if settings.suit_drifts {
            self.anchor.hold(&in_suit_world)
        } else {
            self.anchor.follow(&in_suit_world)
        };

        let mut found = Validity::default();
        let sigma_ns =
            aligned.ground.map_or(0, |ground| ground.sample_time_sigma_ns).max(suit.sample_time_sigma_ns);
        found.raise(Validity::CLOCK_UNSYNCHRONISED, sigma_ns > CLOCK_SIGMA_MAX_NS);

        self.known.suit_sample_time_ns = suit.sample_time_ns;
        self.known.stance = self.anchor.stance() as u32;
        self.known.segment_origin_m = pose.origin.map(Into::into);
        self.estimate(&pose, settings);
        self.compare_with_suggestion(&pose, settings);

        let standing =
            aligned.ground.and_then(|ground| self.stand_on(&ground, &mut found).map(|cop_m| (ground, cop_m)));
        found.raise(Validity::FEET_OFF_PLATE, standing.is_none());
        match standing {
            Some((ground, cop_m)) => {
                let held = Held {
                    time_ns: suit.sample_time_ns,
                    stance: self.anchor.stance(),
                    cop_m,
                    vertical_n: ground.force_n[2],
                    ..bytemuck::Zeroable::zeroed()
                };
                self.window.push(&pose, held, self.alignment.suit_period_ns());
            }
            None => self.window.clear(),
        }

        let stillness = self.window.stillness();
        self.known.static_pose = u32::from(stillness.is_some_and(|window| window.is_still(&settings.still)));
        let nearly_still = stillness.is_some_and(|window| window.is_within(&settings.still, NEARLY_STILL));
        found.raise(Validity::MOVING, !nearly_still);
        if let Some(stillness) = stillness.filter(|window| window.is_still(&settings.still)) {
            self.learn_from_stillness(&pose, &stillness, settings);
        }
        let feet = aligned.ground.and_then(|ground| ground.feet());
        self.overload(&pose, feet.as_ref(), settings, &mut found);
        self.found = found.0;
    }

    /// Centre of mass and, for a still body, of pressure, with the filter's σ, the stance's, and one pose's.
    fn estimate(&mut self, pose: &Pose<StationWorld>, settings: &Settings) {
        if !self.identification.has_body() {
            return;
        }
        let centre = centre_of_mass(pose, &self.identification.phi());
        let rows = self.identification.reduction.rows(pose);
        self.known.com_m = centre.into();
        self.known.cop_estimated_m = [centre.x, centre.y];
        self.known.cop_sigma_m = [0, 1].map(|axis| {
            let variance = self.identification.filter.projected_variance_m2(&rows.h[axis]);
            let pose_sigma_m = settings.measurement_sigma_m;
            let known_to = STANCE_SIGMA_M * STANCE_SIGMA_M + pose_sigma_m * pose_sigma_m;
            math::sqrt(variance + known_to)
        });
    }

    fn compare_with_suggestion(&mut self, pose: &Pose<StationWorld>, settings: &Settings) {
        self.known.pose_mismatch_rad = match settings.library.get(self.identification.suggested as usize) {
            Some(posture) if self.identification.suggested != NO_POSE => {
                let joints = |rotations: [nalgebra::UnitQuaternion<f64>; JOINTS]| rotations.map(|r| wxyz(&r));
                rms_joint_angle(&joints(pose.joint_rotations()), &joints(posture.joint_rotations()))
            }
            _ => 0.0,
        };
    }

    /// A still worker shows the mass, if it is not known, and then one more pose.
    fn learn_from_stillness(
        &mut self,
        pose: &Pose<StationWorld>,
        stillness: &Stillness,
        settings: &Settings,
    ) {
        let worker = &mut self.identification;
        let supported = support::is_supported(pose, stillness.cop_m, settings.height_m, SUPPORT_MARGIN_M);
        if !supported || !self.anchor.both_feet_stand() {
            return;
        }
        let shown_kg = stillness.vertical_n / GRAVITY_M_PER_S2;
        if worker.mass_kg <= 0.0 && BODY_MASS_KG.contains(&shown_kg) {
            worker.mass_kg = shown_kg;
        }
        let weight_n = worker.mass_kg * GRAVITY_M_PER_S2;
        let unloaded = (stillness.vertical_n - weight_n).abs() < settings.still.weight_share * weight_n;
        let wanted = worker.has_body() && worker.learning == 1 && !worker.has_used(&self.window, settings);
        if wanted && unloaded {
            worker.learn_pose(&self.window, stillness, settings);
        }
    }

    /// Eq. 14 and 15; `feet` where each was measured by itself.
    fn overload(
        &mut self,
        pose: &Pose<StationWorld>,
        feet: Option<&Feet>,
        settings: &Settings,
        found: &mut Validity,
    ) {
        let worker = &self.identification;
        let vertical_n = self.known.ground_force_n[2];
        let delta_f_n = vertical_n - worker.mass_kg * GRAVITY_M_PER_S2;
        self.known.delta_f_n = [0.0, 0.0, delta_f_n];
        let loaded = delta_f_n.abs() >= settings.load_threshold_n;
        found.raise(Validity::BELOW_LOAD_THRESHOLD, !loaded);
        if !loaded || !worker.has_body() || found.any_of(Validity::FEET_OFF_PLATE) {
            return;
        }
        let body = worker.anthropometry(settings);
        let grip_m: [Vector3<f64>; 2] =
            Side::BOTH.map(|side| pose.point_on(side.hand(), body.grip_m(side.hand())));
        let (cop_measured_m, cop_estimated_m) = (self.known.cop_measured_m, self.known.cop_estimated_m);
        let by_geometry =
            Sharing::from_geometry(pose, cop_measured_m, cop_estimated_m, vertical_n, delta_f_n, &grip_m);
        let (sharing, source, zeta_sigma) = match feet {
            Some(feet) => {
                let sigma = (settings.force_sigma_n / vertical_n).min(0.5);
                (by_geometry.with_feet(feet, cop_measured_m), SharingSource::Measured, sigma)
            }
            None => (by_geometry, SharingSource::Geometry, Sharing::zeta_sigma_by_geometry(pose)),
        };
        let loading = Loading { cop_measured_m, cop_estimated_m, vertical_n, delta_f_n, grip_m, sharing };
        // The load's place is known as well as the two centres of pressure, magnified by weight over load.
        let place_sigma_m = self.known.cop_sigma_m.iter().copied().fold(0.0, f64::max)
            * (vertical_n - delta_f_n)
            / delta_f_n.abs();
        let between_hands_m = (grip_m[0] - grip_m[1]).xy().norm();
        let sigma = LoadingSigma {
            cop_measured_m: settings.cop_sigma_m,
            cop_estimated_m: self.known.cop_sigma_m,
            delta_f_n: settings.force_sigma_n,
            eta: (place_sigma_m / between_hands_m.max(1e-3)).min(0.5),
            zeta: zeta_sigma,
            foot_without_load_m: if feet.is_some() { sharing::FOOT_WITHOUT_LOAD_SIGMA_M } else { 0.0 },
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

    /// Force and centre of pressure of a ground sample; no centre while nobody stands there or the plate is faulty.
    fn stand_on(&mut self, ground: &GroundSample, found: &mut Validity) -> Option<[f64; 2]> {
        let cop = ground.cop_m();
        found.raise(Validity::PLATE_FAULT, matches!(cop, Err(NoCop::DeviceStatus(_))));
        self.known.ground_force_n = ground.force_n;
        self.known.cop_measured_m = cop.unwrap_or_default();
        cop.ok()
    }

    /// While the suit is silent the ground is still measured.
    pub(super) fn measure_ground_alone(&mut self) {
        let Some(ground) = self.alignment.newest_ground().copied() else { return };
        let mut found = Validity::MOVING;
        let standing = self.stand_on(&ground, &mut found);
        found.raise(Validity::FEET_OFF_PLATE, standing.is_none());
        let weight_n = self.identification.mass_kg * GRAVITY_M_PER_S2;
        self.known.delta_f_n = [0.0, 0.0, ground.force_n[2] - weight_n];
        self.found = found.0;
    }
}

/// No torque, no shares, no colours.
pub(super) fn blank_torques(state: &mut State) {
    state.zeta = [0.0; 2];
    state.sharing_source = SharingSource::Geometry as u32;
    state.eta = [0.0; 2];
    state.load_distance_m = 0.0;
    state.torque_nm = [[0.0; 3]; JOINTS];
    state.torque_sigma_nm = [0.0; JOINTS];
    state.joint_level = [Level::None as u32; JOINTS];
}

/// Table I.
pub(super) fn colour(state: &mut State, settings: &Settings) {
    for joint in 0..JOINTS {
        let magnitude = Vector3::from(state.torque_nm[joint]).norm();
        state.joint_level[joint] = Level::of(magnitude, settings.limits.0[joint]) as u32;
    }
}
