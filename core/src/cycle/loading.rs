//! The carried load, and its torques at the joints (Eq. 14, 15).

use nalgebra::Vector3;

use super::body_motion::BodyMotion;
use super::memory::Memory;
use super::monitoring::SUPPORT_MARGIN_M;
use super::settings::{Motion, Settings};
use super::{foot_outline, support};
use crate::body::{SEGMENTS, Segment, Side};
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::state::SharingSource;
use crate::message::{GroundSample, State, Validity};
use crate::motion::Snapshot;
use crate::motion::unloaded::SIGMAS_OF_A_LOAD;
use crate::overload::load_position::{ANOTHER_GRIP_SIGMAS, ByModel, EVEN_SIGMA, Measured};
use crate::overload::sharing::{TOO_CLOSE_M, project};
use crate::overload::{self, FootLoads, Loading, LoadingSigma, Swing};

/// 1-σ of the point of action under each foot relative to the line common to both, forward and sideways in the foot's
/// axes, m: measured on people who lift objects on two plates.
const PRESS_SIGMA_M: [f64; 2] = [0.020, 0.007];
/// 1-σ of the point of action on the hand, in addition to the uncertainty ahead, m, each of a uniform distribution.
/// Across the hand: the middle third of its breadth at the knuckles, 84 mm. Along it: from the hollow of the palm to
/// the middle of the first phalanges, 42 mm. Normal to the palm: the middle of handles and edges 10 to 50 mm thick.
const GRIP_SIGMA_M: [f64; 3] = [0.0081, 0.0121, 0.0058];

impl Memory {
    /// 1-σ of the external force in this motion, N.
    pub(super) fn delta_f_sigma_n(&self) -> f64 {
        let by_motion_n = self.noise.vertical.sigma(self.noise.vertical_activity_n.height());
        math::hypot([self.ground_sigma.force_n, by_motion_n])
    }

    /// External force above which a load is carried, N.
    pub(super) fn load_limit_n(&self, settings: &Settings) -> f64 {
        match settings.motion {
            Motion::Paper => settings.load_threshold_n,
            Motion::Compensated { .. } => {
                settings.load_threshold_n.max(SIGMAS_OF_A_LOAD * self.delta_f_sigma_n())
            }
        }
    }

    /// Whether a load is carried: detected now, or detected before and not refuted since.
    fn is_loaded(&mut self, delta_f_n: f64, time_ns: u64, settings: &Settings) -> bool {
        let threshold_n = settings.load_threshold_n;
        match settings.motion {
            Motion::Paper => delta_f_n.abs() >= threshold_n,
            Motion::Compensated { .. } => {
                self.load.update(delta_f_n, self.estimate.delta_f_sigma_n, threshold_n, time_ns)
            }
        }
    }

    /// Eq. 14 and 15, `step_s` after the previous instant; the pose is on the plate, with the stance offset applied.
    pub(super) fn overload(
        &mut self,
        pose: &Pose<StationWorld>,
        body: &BodyMotion,
        snapshot: &Snapshot,
        step_s: f64,
        settings: &Settings,
        invalid: &mut Validity,
    ) {
        let vertical_n = self.estimate.ground_force_n[2];
        let unloaded_n = self.unloaded_force_n(body.specific_force_m_per_s2);
        let delta_f_n = vertical_n - unloaded_n - self.terms.force_n[2];
        self.estimate.delta_f_n = [0.0, 0.0, delta_f_n];
        self.estimate.delta_f_sigma_n = self.delta_f_sigma_n();
        let loaded = self.is_loaded(delta_f_n, snapshot.time_ns, settings);
        let subject = &self.identification;
        invalid.raise(Validity::BELOW_LOAD_THRESHOLD, !loaded);
        // In quick motion a load below the raised detection limit cannot be excluded.
        let is_undetectable =
            self.load_limit_n(settings) > settings.load_threshold_n && !self.unloaded.is_quiet();
        invalid.raise(Validity::LOAD_BELOW_DETECTION_LIMIT, !loaded && is_undetectable);
        // A negative load is impossible; the paper's equations do not exclude it.
        let is_missing = loaded && delta_f_n < 0.0 && settings.motion != Motion::Paper;
        invalid.raise(Validity::WEIGHT_MISSING, is_missing);
        if !loaded || is_missing {
            self.load_position.reset();
        }
        if !loaded
            || is_missing
            || !subject.has_body()
            || invalid.any_of(
                Validity::FEET_OFF_PLATE.and(Validity::COP_NOT_MEASURED).and(Validity::POSITION_UNKNOWN),
            )
        {
            return;
        }
        let hands = self.locate_load(pose, body, snapshot, step_s, settings);
        let body_cop = self.cop_given_load(hands.residual_m, vertical_n - delta_f_n, delta_f_n);
        let stance = self.stance_sigma;
        // The part of that correction that is an error of the body's position on the plate, which moves the joints too.
        let body_offset_m = core::array::from_fn(|axis| {
            stance.by_estimate[axis] * (body_cop[axis].value - self.estimate.cop_estimated_m[axis])
        });
        let feet = self.foot_loads(pose, snapshot, body_offset_m, settings);
        let loading = Loading {
            cop_measured_m: self.estimate.cop_measured_m,
            cop_estimated_m: body_cop.map(|cop| cop.value),
            vertical_n,
            delta_f_n,
            grip_m: hands.grip_m,
            eta: hands.eta,
            feet,
            swing: Swing {
                force_n: hands.swing_n,
                body_n: [0, 1].map(|axis| self.identification.mass_kg * body.acceleration_m_per_s2(axis)),
                surface_z_m: snapshot.ground.surface_z_m,
            },
        }
        .displaced(body_offset_m);
        let is_measured = snapshot.ground().and_then(GroundSample::feet).is_some();
        let sigma = LoadingSigma {
            cop_measured_m: self.ground_sigma.cop_m,
            cop_estimated_m: body_cop.map(|cop| cop.sigma),
            position_by_estimate: stance.by_estimate,
            position_m: stance.rest_m,
            delta_f_n: self.estimate.delta_f_sigma_n,
            eta: hands.eta_sigma,
            load_ahead_m: hands.ahead_sigma_m,
            zeta: if is_measured { (self.ground_sigma.force_n / vertical_n).min(0.5) } else { 0.0 },
            press_m: PRESS_SIGMA_M,
            contradiction_m: hands.contradiction_m,
            orientation_rad: settings.suit_orientation_sigma_rad(),
            heading_rad: self.registration.sigma_rad(),
            grip_m: GRIP_SIGMA_M,
            origin_m: self.origin_sigma_m(pose, settings),
        };
        invalid.raise(
            Validity::LOAD_NOT_AT_HANDS,
            hands.distance_m > settings.load_distance_max_m + 2.0 * hands.distance_sigma_m,
        );
        let source = if is_measured { SharingSource::Measured } else { SharingSource::Geometry };
        self.estimate.foot_load_fraction = loading.foot_reactions(pose).map(|foot| foot.with_n / vertical_n);
        self.estimate.sharing_source = source as u32;
        self.estimate.foot_load_fraction_sigma = overload::zeta_sigma(pose, &loading, &sigma);
        (self.estimate.hand_load_fraction, self.estimate.hand_load_fraction_sigma) =
            (hands.eta, hands.eta_sigma);
        let load_m = hands.grip_m[0] * hands.eta[0] + hands.grip_m[1] * hands.eta[1];
        self.load_point_m = [load_m.x, load_m.y];
        self.load_point_sigma_m = hands.position_sigma_m;
        self.estimate.load_hand_distance_m = hands.distance_m;
        for (joint, torque) in overload::torques(pose, &loading, &sigma).into_iter().enumerate() {
            self.estimate.torque_nm[joint] = torque.torque_nm.into();
            self.estimate.torque_sigma_nm[joint] = torque.sigma_nm;
            self.estimate.torque_covariance_nm2[joint] = torque.covariance_nm2;
        }
    }

    /// Difference between the suit's positions and those by its orientations along the subject's bones: soft tissue.
    fn origin_sigma_m(&self, pose: &Pose<StationWorld>, settings: &Settings) -> [Vector3<f64>; SEGMENTS] {
        if settings.motion == Motion::Paper {
            return [Vector3::zeros(); SEGMENTS];
        }
        let along_bones = pose.origins_along(&self.identification.skeleton());
        core::array::from_fn(|segment| along_bones[segment] - pose.origin[segment])
    }

    /// Ĉ_wo, world x and y, m, conditional on the position of the load in the hands. The load's position by the two
    /// CoPs has the error of Ĉ_wo times W/ΔF, and the hands have the part of that error that displaces the body: part
    /// of the distance between them is that error (conditional normal distribution).
    fn cop_given_load(&self, residual_m: [Measured; 2], weight_n: f64, delta_f_n: f64) -> [Measured; 2] {
        core::array::from_fn(|axis| {
            let (value, sigma) = (self.estimate.cop_estimated_m[axis], self.estimate.cop_sigma_m[axis]);
            let residual = residual_m[axis];
            // `residual.sigma` contains the error of Ĉ_wo without the displacement of the hands.
            let by_cops = weight_n / delta_f_n;
            let by_both = by_cops + self.stance_sigma.by_estimate[axis];
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
    fn foot_loads(
        &self,
        pose: &Pose<StationWorld>,
        snapshot: &Snapshot,
        body_offset_m: [f64; 2],
        settings: &Settings,
    ) -> FootLoads {
        let cop_m = self.estimate.cop_measured_m;
        if let Some(feet) = snapshot.ground().and_then(GroundSample::feet) {
            return FootLoads::measured(&feet, cop_m);
        }
        let ankle = Side::BOTH.map(|side| pose.origin_of(side.foot()));
        if settings.motion == Motion::Paper {
            let (right, _) = project(cop_m, ankle.map(|ankle| [ankle.x, ankle.y]));
            return FootLoads::Common { zeta: [1.0 - right, right] };
        }
        let outlines = foot_outline::both(pose, self.reported_body.body(), settings.height_m);
        let relative_m = core::array::from_fn(|axis| cop_m[axis] - body_offset_m[axis]);
        FootLoads::Geometry {
            press_m: [[0.0; 2]; 2],
            stands: support::bearing_feet(pose, relative_m, &outlines, SUPPORT_MARGIN_M),
        }
    }

    /// Position of the load in the hands.
    fn locate_load(
        &mut self,
        pose: &Pose<StationWorld>,
        body: &BodyMotion,
        snapshot: &Snapshot,
        step_s: f64,
        settings: &Settings,
    ) -> LoadInHands {
        let subject = &self.identification;
        let table = subject.anthropometry();
        let grip_m: [Vector3<f64>; 2] =
            Side::BOTH.map(|side| pose.point_on(side.hand(), table.grip_m(side.hand())));
        let State { cop_measured_m, cop_estimated_m, delta_f_n: [_, _, delta_f_n], .. } = self.estimate;
        let vertical_n = self.estimate.ground_force_n[2];
        let weight_n = vertical_n - delta_f_n;
        let is_paper = settings.motion == Motion::Paper;
        let eta = self.load_position.eta();
        let height_m = eta[0] * grip_m[0].z + eta[1] * grip_m[1].z - snapshot.ground.surface_z_m;
        // Acceleration of the load: of the hands, weighted by their load fractions.
        let acceleration = |axis: usize| {
            let [left, right] = body.hand_acceleration_m_per_s2;
            eta[0] * left[axis] + eta[1] * right[axis]
        };
        let swing = if is_paper { [0.0; 2] } else { [acceleration(0), acceleration(1)] };
        // The CoP of an accelerated load at x is x − z ẍ/(g + z̈).
        let load_m: [f64; 2] = core::array::from_fn(|axis| {
            let by_cops_m =
                (cop_measured_m[axis] * vertical_n - cop_estimated_m[axis] * weight_n) / delta_f_n;
            by_cops_m + height_m * swing[axis] / body.load_weight_m_per_s2()
        });
        let between: [[f64; 2]; 2] = grip_m.map(|grip| [grip.x, grip.y]);
        let (right_hand, distance_m) = project(load_m, between);
        // Uncertainty of the load's position: that of the two CoPs, magnified by weight over load, and that of the
        // hands.
        let chain_m = self.orientation_sigma_rad(settings) * settings.height_m;
        let sigma_m: [f64; 2] = core::array::from_fn(|axis| {
            let by_estimate_m = self.estimate.cop_sigma_m[axis] * weight_n / delta_f_n;
            let by_measurement_m = self.ground_sigma.cop_m * vertical_n / delta_f_n;
            let by_force_m =
                (load_m[axis] - cop_estimated_m[axis]) * self.estimate.delta_f_sigma_n / delta_f_n;
            math::hypot([math::hypot([by_estimate_m, by_measurement_m]), math::hypot([by_force_m, chain_m])])
        });
        let distance_sigma_m = sigma_m[0].max(sigma_m[1]);
        let apart = grip_m[1] - grip_m[0];
        let apart_m = math::hypot([apart.x, apart.y]);
        if is_paper {
            let eta_sigma = (distance_sigma_m / apart_m.max(1e-3)).min(0.5);
            let eta = [1.0 - right_hand, right_hand];
            let (ahead_sigma_m, swing_n) = ([0.0; 2], [0.0; 2]);
            let residual_m = [Measured { value: 0.0, sigma: f64::INFINITY }; 2];
            let position_sigma_m = [0.0; 2];
            return LoadInHands {
                grip_m,
                eta,
                eta_sigma,
                ahead_sigma_m,
                position_sigma_m,
                residual_m,
                contradiction_m: 0.0,
                swing_n,
                distance_m,
                distance_sigma_m,
            };
        }
        let are_together = apart_m < TOO_CLOSE_M;
        // Direction from the left to the right hand; for hands close together, the direction of the pelvis.
        let aside = if are_together {
            let right = pose.world_from_segment[0] * -Vector3::y();
            [right.x, right.y].map(|part| part / math::hypot([right.x, right.y]).max(1e-9))
        } else {
            [apart.x / apart_m, apart.y / apart_m]
        };
        let middle = [0, 1].map(|axis| 0.5 * (between[0][axis] + between[1][axis]));
        // Away from the body, also if the hands cross.
        let pelvis = pose.origin_of(Segment::Pelvis);
        let is_away = aside[0] * (middle[1] - pelvis.y) - aside[1] * (middle[0] - pelvis.x) >= 0.0;
        let ahead = if is_away { [-aside[1], aside[0]] } else { [aside[1], -aside[0]] };
        let rows = subject.reduction.rows(pose, body.slope);
        let cop_rows = [0, 1].map(|axis| subject.with_stance(&rows, axis));
        let magnified = weight_n / delta_f_n;
        let by_model_m2 = subject.cop_variance_m2(&rows).map(|cop_m2| cop_m2 * magnified * magnified);
        let rest_m2 = [0, 1].map(|axis| (sigma_m[axis] * sigma_m[axis] - by_model_m2[axis]).max(0.0));
        // The load's position along a direction from the middle between the grips, per unit.
        let along = |direction: [f64; 2], unit_m: f64| {
            let value: f64 = (0..2).map(|axis| direction[axis] * (load_m[axis] - middle[axis])).sum();
            let rest_m2: f64 = (0..2).map(|axis| direction[axis] * direction[axis] * rest_m2[axis]).sum();
            let parts = direction.map(|part| -part * magnified / unit_m);
            ByModel {
                measured: Measured { value: value / unit_m, sigma: math::sqrt(rest_m2) / unit_m },
                row: core::array::from_fn(|state| {
                    parts[0] * cop_rows[0][state] + parts[1] * cop_rows[1][state]
                }),
            }
        };
        let from_middle = along(aside, apart_m);
        let right = ByModel {
            measured: Measured { value: 0.5 + from_middle.measured.value, ..from_middle.measured },
            ..from_middle
        };
        self.load_position.update((!are_together).then_some(&right), &along(ahead, 1.0), step_s, |row| {
            subject.filter.times_covariance(row)
        });
        let [ahead_m, ahead_sigma_m] = self.load_position.ahead_m();
        let offset = Vector3::new(ahead[0] * ahead_m, ahead[1] * ahead_m, 0.0);
        let (eta, eta_sigma) = (self.load_position.eta(), self.load_position.eta_sigma());
        let ahead_sigma_m = ahead.map(|part| part * ahead_sigma_m);
        let of_hands_m2 = Side::BOTH.map(|side| overload::grip_covariance_m2(pose, side, GRIP_SIGMA_M));
        let position_sigma_m: [f64; 2] = core::array::from_fn(|axis| {
            let aside_sigma_m = aside[axis] * eta_sigma * apart_m;
            // Independent on both hands; xx and yy of the covariance.
            let grip_m2: f64 = (0..2).map(|hand| eta[hand] * eta[hand] * of_hands_m2[hand][2 * axis]).sum();
            let hands_sigma_m = math::hypot([aside_sigma_m, ahead_sigma_m[axis]]);
            math::hypot([hands_sigma_m, math::sqrt(grip_m2)])
        });
        let residual_m = core::array::from_fn(|axis| {
            let in_hands_m = eta[0] * between[0][axis] + eta[1] * between[1][axis] + offset[axis];
            let sigma = math::hypot([sigma_m[axis], position_sigma_m[axis]]);
            Measured { value: load_m[axis] - in_hands_m, sigma }
        });
        // The assumed grip is wrong, or a CoP is: the fractions are then unknown by as much.
        let is_contradiction =
            residual_m.iter().any(|residual: &Measured| residual.is_beyond(ANOTHER_GRIP_SIGMAS));
        let contradiction_m =
            if is_contradiction { math::hypot(residual_m.map(|residual| residual.value)) } else { 0.0 };
        let eta_sigma = math::hypot([eta_sigma, contradiction_m / apart_m.max(TOO_CLOSE_M)]).min(EVEN_SIGMA);
        let load_kg = body.load_kg(delta_f_n);
        LoadInHands {
            grip_m: grip_m.map(|grip_m| grip_m + offset),
            eta,
            eta_sigma,
            ahead_sigma_m,
            position_sigma_m,
            residual_m,
            contradiction_m,
            swing_n: swing.map(|acceleration| load_kg * acceleration),
            distance_m,
            distance_sigma_m,
        }
    }
}

/// Position of a load in the hands.
struct LoadInHands {
    /// Point of action of each hand's fraction of the load, m.
    grip_m: [Vector3<f64>; 2],
    /// Hand load fractions.
    eta: [f64; 2],
    eta_sigma: f64,
    /// 1-σ of the load's distance ahead of the grips, a horizontal vector, m.
    ahead_sigma_m: [f64; 2],
    /// 1-σ of the load's position in the hands, world x and y, m.
    position_sigma_m: [f64; 2],
    /// Load position by the two CoPs minus the position in the hands, world x and y, m.
    residual_m: [Measured; 2],
    /// Their length if they contradict each other, m; otherwise 0.
    contradiction_m: f64,
    /// Horizontal force that accelerates the load, N.
    swing_n: [f64; 2],
    /// Distance of the load from the line between the grips, by the two CoPs, and its 1-σ, m.
    distance_m: f64,
    distance_sigma_m: f64,
}
