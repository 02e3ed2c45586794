//! What an aligned sample says to ergonomists and cobots: load, back, fatigue, dose, advice.

use nalgebra::Vector3;

use super::body_motion::BodyMotion;
use super::memory::Memory;
use super::settings::Settings;
use super::{MODEL_CHANGED_NS, NO_JOINT};
use crate::body::{JOINTS, Joint, Segment, Side};
use crate::exposure::back::{LoadAtBack, UpperBody};
use crate::exposure::{Advice, Back, Load, advice, dose, lift};
use crate::frame::{Pose, StationWorld};
use crate::message::{State, Validity};
use crate::overload::{GRAVITY_M_PER_S2, leverage};
use crate::sesc::distal_mass;

/// The joint between trunk and pelvis.
const L5S1: Joint = Joint::ALL[0];

impl Memory {
    /// Works through what the sample's torques mean. Comes after them.
    pub(super) fn expose(
        &mut self,
        pose: &Pose<StationWorld>,
        body: &BodyMotion,
        settings: &Settings,
        found: Validity,
    ) {
        let magnitude_nm = self.known.torque_nm.map(|torque_nm| Vector3::from(torque_nm).norm());
        let load = self.load(found, &magnitude_nm);
        self.exposure.advance(self.known.suit_sample_time_ns, &load, &settings.limits);
        self.known.torque_limit_nm = settings.limits.0;
        self.tell_exposure();

        blank(&mut self.known);
        if !self.identification.has_body()
            || found.any_of(Validity::FEET_OFF_PLATE.and(Validity::COP_NOT_MEASURED))
        {
            return;
        }
        let loaded = !found.any_of(Validity::BELOW_LOAD_THRESHOLD);
        if !found.any_of(Validity::LOAD_MAY_HIDE) {
            self.judge_back(pose, loaded);
        }
        if loaded {
            self.judge_load(pose, body, settings, &magnitude_nm);
        }
    }

    /// What has added up over this worker's shift.
    pub(super) fn tell_exposure(&mut self) {
        self.known.fatigue = self.exposure.fatigue.share;
        self.known.dose_damage = self.exposure.dose.damage;
        self.known.dose_probability = dose::probability(self.exposure.dose.damage);
        self.known.lifts = self.exposure.dose.lifts.min(u64::from(u32::MAX)) as u32;
    }

    /// What is known about the load, by the reasons that this sample and the worker's model give.
    fn load(&self, found: Validity, magnitude_nm: &[f64; JOINTS]) -> Load {
        let worker = &self.identification;
        let weighed = worker.mass_kg > 0.0;
        if found == Validity::BELOW_LOAD_THRESHOLD && weighed {
            return Load::None;
        }
        let since_change_ns = self.known.suit_sample_time_ns.saturating_sub(self.model_changed_ns);
        let changed = self.model_changed_ns > 0 && since_change_ns < MODEL_CHANGED_NS;
        let told = weighed && worker.has_body() && worker.identified == 1 && !changed;
        if !told || found.any_of(Validity::SPOILS_TORQUES) {
            return Load::Unknown;
        }
        Load::Known {
            torque_nm: *magnitude_nm,
            lift_moment_nm: magnitude_nm[L5S1.index()],
            is_lift: self.known.delta_f_n[2] > 0.0,
        }
    }

    fn judge_back(&mut self, pose: &Pose<StationWorld>, loaded: bool) {
        let worker = &self.identification;
        let weight_n = worker.mass_kg * GRAVITY_M_PER_S2;
        let phi = worker.phi();
        let above = |segment: Segment| segment.is_distal_to(L5S1.segment());
        let arm_m: Vector3<f64> = Segment::ALL
            .into_iter()
            .filter(|segment| above(*segment))
            .map(|segment| pose.world_from_segment[segment.index()] * Vector3::from(phi.0[segment.index()]))
            .sum();
        let rows = worker.reduction.rows_over(pose, [0.0; 2], above);
        let body = UpperBody {
            weight_arm_nm: [weight_n * arm_m.x, weight_n * arm_m.y],
            variance_nm2: worker.parameter_variance_m2(&rows).map(|variance| weight_n * weight_n * variance),
            weight_n: weight_n * distal_mass(&worker.anthropometry().mass_fraction)[L5S1.segment().index()],
            upright: (pose.world_from_segment[L5S1.segment().index()] * Vector3::z()).z,
        };
        let load = if loaded {
            LoadAtBack {
                torque_nm: self.known.torque_nm[L5S1.index()].into(),
                torque_sigma_nm: self.known.torque_sigma_nm[L5S1.index()],
                delta_f_n: self.known.delta_f_n[2],
            }
        } else {
            LoadAtBack::NONE
        };
        let back = Back::of(&body, &load);
        self.known.l5s1_moment_nm = back.moment_nm;
        self.known.l5s1_moment_sigma_nm = back.moment_sigma_nm;
        self.known.l5s1_compression_n = back.compression_n;
        self.known.l5s1_compression_sigma_n = back.compression_sigma_n;
    }

    fn judge_load(
        &mut self,
        pose: &Pose<StationWorld>,
        body_motion: &BodyMotion,
        settings: &Settings,
        magnitude_nm: &[f64; JOINTS],
    ) {
        let body = self.identification.anthropometry();
        let grip_m = Side::BOTH.map(|side| pose.point_on(side.hand(), body.grip_m(side.hand())));
        let known = &mut self.known;
        let (vertical_n, delta_f_n) = (known.ground_force_n[2], known.delta_f_n[2]);
        let sigma_n = known.delta_f_sigma_n.max(settings.force_sigma_n);
        [known.lifted_mass_kg, known.lifted_mass_sigma_kg] =
            lift::lifted_mass_kg(delta_f_n, sigma_n, body_motion.load_weight_m_per_s2());

        let weight_n = vertical_n - delta_f_n;
        let place = lift::Place {
            by_pressure_m: [0, 1].map(|axis| {
                (known.cop_measured_m[axis] * vertical_n - known.cop_estimated_m[axis] * weight_n) / delta_f_n
            }),
            pressure_sigma_m: known.cop_sigma_m.map(|sigma_m| sigma_m * weight_n / delta_f_n),
            grip_middle_m: [0, 1].map(|axis| 0.5 * (grip_m[0][axis] + grip_m[1][axis])),
        };
        let [left, right] = Side::BOTH.map(|side| pose.origin_of(side.foot()));
        known.reach_m = place.reach_m([0, 1].map(|axis| 0.5 * (left[axis] + right[axis])));

        let Some(worst) = advice::worst_joint(magnitude_nm, &settings.limits.0) else { return };
        let index = worst.index();
        let leverage = leverage(worst, known.zeta, known.eta);
        let (torque_nm, sigma_nm) = (known.torque_nm[index], known.torque_sigma_nm[index]);
        let advice = Advice::of(leverage, delta_f_n, torque_nm, sigma_nm);
        known.worst_joint = index as u32;
        known.advice_direction = advice.direction;
        known.advice_gain_nm_per_cm = advice.gain_nm_per_cm;
    }
}

/// Nothing is known of load and back. What has added up stays: it is true however the sensors are.
fn blank(state: &mut State) {
    blank_load(state);
    blank_advice(state);
    blank_back(state);
}

fn blank_load(state: &mut State) {
    state.lifted_mass_kg = 0.0;
    state.lifted_mass_sigma_kg = 0.0;
}

fn blank_advice(state: &mut State) {
    state.reach_m = 0.0;
    state.worst_joint = NO_JOINT;
    state.advice_direction = [0.0; 3];
    state.advice_gain_nm_per_cm = 0.0;
}

fn blank_back(state: &mut State) {
    state.l5s1_moment_nm = 0.0;
    state.l5s1_moment_sigma_nm = 0.0;
    state.l5s1_compression_n = 0.0;
    state.l5s1_compression_sigma_n = 0.0;
}

/// A spoilt value is zero.
pub(super) fn blank_spoilt(state: &mut State) {
    let valid = state.validity();
    if valid.any_of(Validity::SPOILS_LIFTED_MASS) {
        blank_load(state);
    }
    if valid.any_of(Validity::SPOILS_TORQUES) {
        blank_advice(state);
    }
    if valid.any_of(Validity::SPOILS_BACK) {
        blank_back(state);
    }
}
