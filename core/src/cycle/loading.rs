//! Stage `overload`: the carried load, and its torques at the joints (Eq. 14, 15).

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;

use super::cop_estimate::Estimate;
use super::differentiate::Instant;
use super::ground::Ground;
use super::identify::Identified;
use super::load_after_gap::{LoadAfterGap, LoadNow};
use super::load_in_hands::{LoadInHands, hold_load, locate_load};
use super::prediction::Prediction;
use super::settings::{Motion, Settings};
use super::validity::time_is_uncertain;
use super::{foot_outline, support};
use crate::body::{JOINTS, SEGMENTS, Side};
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::state::SharingSource;
use crate::message::{GroundDevice, GroundSample, Validity};
use crate::motion::{Load, Unloaded};
use crate::overload::load_position::{ANOTHER_GRIP_SIGMAS, LoadPosition, Measured};
use crate::overload::sharing::project;
use crate::overload::{self, FootDeviation, FootLoads, Loading, LoadingSigma, Swing, Torque};

/// Tolerance for a CoP outside the modelled foot outlines, m.
pub(super) const SUPPORT_MARGIN_M: f64 = 0.02;
/// Maximum mass in the hands, kg: eight times the reference mass of ISO 11228-1 for men, 25 kg; of people of average
/// mass only trained athletes lift more from the floor.
const LOAD_MAX_KG: f64 = 200.0;

/// State of the stage.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct LoadState {
    /// Detector of a load.
    detector: Load,
    /// Position of the load in the hands.
    pub(super) position: LoadPosition,
    /// Comparison with the load before a gap of the ground's samples.
    after_gap: LoadAfterGap,
}

impl LoadState {
    /// Starts with another subject. Whether the device may have another gain does not depend on the subject.
    pub(super) fn start_subject(&mut self) {
        *self = LoadState { after_gap: self.after_gap.for_another_subject(), ..Zeroable::zeroed() };
    }

    /// Resets the position of the load in the hands: it was computed with another model.
    pub(super) fn reset_position(&mut self) {
        self.position.reset();
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.detector.is_sound() && self.position.is_sound() && self.after_gap.is_sound()
    }

    /// Whether a load is carried: detected now, or detected before and not refuted since.
    fn detect(&mut self, settings: &Settings, delta_f_n: f64, sigma_n: f64, time_ns: u64) -> bool {
        let threshold_n = settings.load_threshold_n;
        match settings.motion {
            Motion::Paper => delta_f_n.abs() >= threshold_n,
            Motion::Compensated { .. } => self.detector.update(delta_f_n, sigma_n, threshold_n, time_ns),
        }
    }

    /// Whether the load of an instant is implausible: more than hands hold, or perhaps the effect of a gap of the
    /// ground's samples.
    fn is_implausible(
        &mut self,
        settings: &Settings,
        prediction: &Prediction,
        subject: Identified<'_>,
        now: &LoadNow,
    ) -> bool {
        if settings.motion == Motion::Paper || subject.mass_kg <= 0.0 {
            return false;
        }
        if now.is_loaded && prediction.body.load_kg(now.delta_f_n) > LOAD_MAX_KG {
            return true;
        }
        // Before the identification the mass may be that of another gain.
        let is_measured = prediction.is_measured && now.delta_f_n.is_finite() && now.sigma_n.is_finite();
        subject.identified != 0 && is_measured && now.ground_ns > 0 && self.after_gap.is_doubtful(now)
    }
}

/// External force and, with a load, its effect at one instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Overload {
    /// Vertical external force and its 1-σ, N.
    pub(super) delta_f_n: f64,
    pub(super) delta_f_sigma_n: f64,
    /// The load; `None` without one, or where its position is unavailable.
    pub(super) load: Option<CarriedLoad>,
    /// Validity flags raised by the stage.
    pub(super) invalid: Validity,
}

/// A carried load and its torques.
#[derive(Debug, Clone, Copy)]
pub(super) struct CarriedLoad {
    /// Horizontal position, world, and its 1-σ in the hands, m.
    pub(super) point_m: [f64; 2],
    pub(super) point_sigma_m: [f64; 2],
    /// Foot and hand load fractions, each with its 1-σ.
    pub(super) zeta: [f64; 2],
    pub(super) zeta_sigma: f64,
    pub(super) sharing_source: SharingSource,
    pub(super) eta: [f64; 2],
    pub(super) eta_sigma: f64,
    /// Distance of the load from the line between the hands, m.
    pub(super) distance_m: f64,
    /// Torque per joint.
    pub(super) torques: [Torque; JOINTS],
}

/// Force that a load adds to that of the unloaded body.
#[derive(Debug, Clone, Copy)]
pub(super) struct ExternalForce {
    /// Vertical ground reaction, N.
    pub(super) vertical_n: f64,
    /// Vertical external force and its 1-σ, N.
    pub(super) delta_f_n: f64,
    pub(super) sigma_n: f64,
}

impl ExternalForce {
    /// Vertical ground reaction without the load, N.
    pub(super) fn weight_n(&self) -> f64 {
        self.vertical_n - self.delta_f_n
    }
}

/// Eq. 14 and 15: detects a load, and computes its torques on the plate. `None` while samples of suit or ground are
/// implausible.
pub(super) fn overload(
    settings: &Settings,
    (state, unloaded): (&mut LoadState, &Unloaded),
    instant: &Instant,
    ground: &Ground,
    prediction: &Prediction,
    estimate: &Estimate,
    subject: Identified<'_>,
) -> Option<Overload> {
    if ground.is_suspect() {
        return None;
    }
    let vertical_n = ground.reading.force_n[2];
    let unloaded_n = ground.unloaded_force_n(&subject, prediction.body.specific_force_m_per_s2);
    let delta_f_n = vertical_n - unloaded_n - prediction.terms_force_n[2];
    let sigma_n = prediction.delta_f_sigma_n;
    let loaded = state.detect(settings, delta_f_n, sigma_n, instant.snapshot.time_ns);
    let mut invalid = Validity::default();
    invalid.raise(Validity::BELOW_LOAD_THRESHOLD, !loaded);
    // In quick motion a load below the raised detection limit cannot be excluded.
    let is_undetectable = prediction.load_limit_n > settings.load_threshold_n && !unloaded.is_quiet();
    invalid.raise(Validity::LOAD_BELOW_DETECTION_LIMIT, !loaded && is_undetectable);
    // A negative load is impossible; the paper's equations do not exclude it.
    let is_missing = loaded && delta_f_n < 0.0 && settings.motion != Motion::Paper;
    invalid.raise(Validity::WEIGHT_MISSING, is_missing);
    let is_carried = loaded && !is_missing;
    if !is_carried {
        state.position.reset();
    }
    // The huge σ of an unknown time would last in the mean before a gap.
    let certain = instant.snapshot.ground().filter(|_| !time_is_uncertain(&instant.snapshot));
    let now = LoadNow {
        ground_ns: certain.map_or(0, |sample| sample.sample_time_ns),
        resumed_ns: ground.resumed_ns,
        delta_f_n,
        sigma_n,
        threshold_n: settings.load_threshold_n,
        weight_m_per_s2: prediction.body.load_weight_m_per_s2(),
        is_loaded: is_carried,
    };
    let is_implausible = state.is_implausible(settings, prediction, subject, &now);
    invalid.raise(Validity::GROUND_IMPLAUSIBLE, is_implausible);
    let has_place = !instant.place_is_lost
        && !ground.invalid.any_of(Validity::FEET_OFF_PLATE.and(Validity::COP_NOT_MEASURED));
    let load = (is_carried && !is_implausible && subject.has_body() && has_place).then(|| {
        let force = ExternalForce { vertical_n, delta_f_n, sigma_n };
        let hands = locate_load(
            settings,
            &mut state.position,
            &Carrying { instant, ground, prediction, estimate, subject, force },
        );
        let distance_max_m = settings.load_distance_max_m + 2.0 * hands.distance_sigma_m;
        invalid.raise(Validity::LOAD_NOT_AT_HANDS, hands.distance_m > distance_max_m);
        Carrying { instant, ground, prediction, estimate, subject, force }.torques(settings, &hands)
    });
    Some(Overload { delta_f_n, delta_f_sigma_n: sigma_n, load, invalid })
}

/// Outputs of the earlier stages while a load is carried.
#[derive(Clone, Copy)]
pub(super) struct Carrying<'a> {
    pub(super) instant: &'a Instant,
    pub(super) ground: &'a Ground,
    pub(super) prediction: &'a Prediction,
    pub(super) estimate: &'a Estimate,
    pub(super) subject: Identified<'a>,
    pub(super) force: ExternalForce,
}

impl Carrying<'_> {
    /// The torques of a load at its present position in the hands, without their errors, N m.
    pub(super) fn torque_vectors(&self, settings: &Settings, state: &LoadState) -> [Vector3<f64>; JOINTS] {
        let hands = hold_load(settings, &state.position, self);
        let body_cop = self.cop_given_load(hands.residual_m);
        overload::torque_vectors(&self.estimate.on_plate, &self.loading(settings, &hands, &body_cop))
    }

    /// The load's torques, given its position in the hands.
    fn torques(&self, settings: &Settings, hands: &LoadInHands) -> CarriedLoad {
        let (pose, force) = (&self.estimate.on_plate, &self.force);
        let body_cop = self.cop_given_load(hands.residual_m);
        let loading = self.loading(settings, hands, &body_cop);
        let is_measured = self.feet().is_some();
        let sigma = self.sigma(settings, hands, &body_cop, is_measured);
        let load_m = hands.grip_m[0] * hands.eta[0] + hands.grip_m[1] * hands.eta[1];
        CarriedLoad {
            point_m: [load_m.x, load_m.y],
            point_sigma_m: hands.position_sigma_m,
            zeta: loading.foot_reactions(pose).map(|foot| foot.with_n / force.vertical_n),
            zeta_sigma: overload::zeta_sigma(pose, &loading, &sigma),
            sharing_source: if is_measured { SharingSource::Measured } else { SharingSource::Geometry },
            eta: hands.eta,
            eta_sigma: hands.eta_sigma,
            distance_m: hands.distance_m,
            torques: overload::torques(pose, &loading, &sigma),
        }
    }

    /// Inputs of the torques.
    fn loading(&self, settings: &Settings, hands: &LoadInHands, body_cop: &[Measured; 2]) -> Loading {
        let force = &self.force;
        // The part of that correction that is an error of the body's position on the plate, which moves the joints too.
        let body_offset_m: [f64; 2] = core::array::from_fn(|axis| {
            self.estimate.stance.by_estimate[axis] * (body_cop[axis].value - self.estimate.cop_m[axis])
        });
        Loading {
            cop_measured_m: self.ground.reading.cop_m,
            cop_estimated_m: body_cop.map(|cop| cop.value),
            vertical_n: force.vertical_n,
            delta_f_n: force.delta_f_n,
            grip_m: hands.grip_m,
            eta: hands.eta,
            feet: self.foot_loads(settings, body_offset_m),
            deviation: FootDeviation::NONE,
            swing: Swing {
                force_n: hands.swing_n,
                body_n: [0, 1]
                    .map(|axis| self.subject.mass_kg * self.prediction.body.acceleration_m_per_s2(axis)),
                surface_z_m: self.instant.snapshot.ground.surface_z_m,
            },
        }
        .displaced(body_offset_m)
    }

    /// 1-σ of the inputs of the torques.
    fn sigma(
        &self,
        settings: &Settings,
        hands: &LoadInHands,
        body_cop: &[Measured; 2],
        feet_are_measured: bool,
    ) -> LoadingSigma {
        let (ground, stance) = (&self.ground.sigma, &self.estimate.stance);
        // Next to a plate, only the insoles measure the fractions.
        let by_insoles = self.instant.snapshot.ground.devices & GroundDevice::Insoles as u32 != 0;
        let insole_n = if by_insoles { settings.insole_force_sigma_n } else { 0.0 };
        let foot_n = if feet_are_measured { ground.force_n.max(insole_n) } else { 0.0 };
        LoadingSigma {
            cop_measured_m: ground.cop_m,
            cop_estimated_m: body_cop.map(|cop| cop.sigma),
            position_by_estimate: stance.by_estimate,
            position_m: stance.rest_m,
            delta_f_n: self.force.sigma_n,
            eta: hands.eta_sigma,
            load_ahead_m: hands.ahead_sigma_m,
            zeta: (foot_n / self.force.vertical_n).min(0.5),
            contradiction_m: hands.contradiction_m,
            orientation_rad: settings.suit_orientation_sigma_rad(),
            heading_rad: self.instant.heading_sigma_rad,
            origin_m: self.origin_sigma_m(settings),
            ..LoadingSigma::of_contacts(self.force.delta_f_n)
        }
    }

    /// Measured wrench of each foot.
    fn feet(&self) -> Option<crate::message::ground::Feet> {
        self.instant.snapshot.ground().and_then(GroundSample::feet)
    }

    /// Difference between the suit's positions and those by its orientations along the subject's bones: soft tissue.
    fn origin_sigma_m(&self, settings: &Settings) -> [Vector3<f64>; SEGMENTS] {
        if settings.motion == Motion::Paper {
            return [Vector3::zeros(); SEGMENTS];
        }
        let pose: &Pose<StationWorld> = &self.estimate.on_plate;
        let along_bones = pose.origins_along(&self.subject.skeleton());
        core::array::from_fn(|segment| along_bones[segment] - pose.origin[segment])
    }

    /// Ĉ_wo, world x and y, m, conditional on the position of the load in the hands. The load's position by the two
    /// CoPs has the error of Ĉ_wo times W/ΔF, and the hands have the part of that error that displaces the body: part
    /// of the distance between them is that error (conditional normal distribution).
    fn cop_given_load(&self, residual_m: [Measured; 2]) -> [Measured; 2] {
        core::array::from_fn(|axis| {
            let (value, sigma) = (self.estimate.cop_m[axis], self.estimate.cop_sigma_m[axis]);
            let residual = residual_m[axis];
            // `residual.sigma` contains the error of Ĉ_wo without the displacement of the hands.
            let by_cops = self.force.weight_n() / self.force.delta_f_n;
            let by_both = by_cops + self.estimate.stance.by_estimate[axis];
            let by_hands_m2 = (by_both * by_both - by_cops * by_cops) * sigma * sigma;
            let variance_m2 = residual.sigma * residual.sigma + by_hands_m2;
            // At this distance from the hands, the assumed grip is wrong.
            let is_other_grip =
                residual.value * residual.value > ANOTHER_GRIP_SIGMAS * ANOTHER_GRIP_SIGMAS * variance_m2;
            if is_other_grip || variance_m2.is_nan() || variance_m2 <= 0.0 {
                return Measured { value, sigma };
            }
            let gain = by_both * sigma * sigma / variance_m2;
            Measured {
                value: value + gain * residual.value,
                sigma: sigma * math::sqrt((1.0 - by_both * gain).max(0.0)),
            }
        })
    }

    /// Distribution of the ground reaction between the feet: measured, or from the ankles of a body whose position is
    /// off by `body_offset_m`.
    fn foot_loads(&self, settings: &Settings, body_offset_m: [f64; 2]) -> FootLoads {
        let (pose, cop_m) = (&self.estimate.on_plate, self.ground.reading.cop_m);
        if let Some(feet) = self.feet() {
            return FootLoads::measured(&feet, cop_m);
        }
        let ankle = Side::BOTH.map(|side| pose.origin_of(side.foot()));
        if settings.motion == Motion::Paper {
            let (right, _) = project(cop_m, ankle.map(|ankle| [ankle.x, ankle.y]));
            return FootLoads::Common { zeta: [1.0 - right, right] };
        }
        let outlines = foot_outline::both(pose, self.instant.suit_body.as_ref(), settings.height_m);
        let relative_m = core::array::from_fn(|axis| cop_m[axis] - body_offset_m[axis]);
        FootLoads::Geometry {
            press_m: [[0.0; 2]; 2],
            stands: support::bearing_feet(pose, relative_m, &outlines, SUPPORT_MARGIN_M),
        }
    }
}
