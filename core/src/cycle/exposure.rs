//! Exposure values of an aligned sample: load, back, fatigue, dose, advice.

use nalgebra::Vector3;

use super::body_motion::BodyMotion;
use super::memory::Memory;
use super::settings::Settings;
use super::{MODEL_CHANGED_NS, NO_JOINT};
use crate::body::{JOINTS, Joint, Segment, Side};
use crate::exposure::back::{Arm, LoadAtBack, UpperBody};
use crate::exposure::{Advice, Back, Carried, Load, advice, dose, lift};
use crate::frame::{Pose, StationWorld};
use crate::math;
use crate::message::{State, Validity};
use crate::overload::{GRAVITY_M_PER_S2, leverage};
use crate::sesc::distal_mass;
use crate::sesc::suit_error::{EffectiveVectors, drift_variance_m2};

/// The joint between trunk and pelvis.
const L5S1: Joint = Joint::ALL[0];

impl Memory {
    /// Computes the exposure from the sample's torques, which must be up to date.
    pub(super) fn update_exposure(
        &mut self,
        pose: &Pose<StationWorld>,
        body: &BodyMotion,
        settings: &Settings,
        invalid: Validity,
    ) {
        let magnitude_nm = self.estimate.torque_nm.map(|torque_nm| Vector3::from(torque_nm).norm());
        let load = self.load(pose, body, settings, invalid, &magnitude_nm);
        self.estimate.torque_limit_nm = settings.limits.along_nm(pose, &self.estimate.torque_nm);
        self.exposure.advance(self.estimate.suit_sample_time_ns, &load, &self.estimate.torque_limit_nm);
        self.publish_exposure();

        mask_all(&mut self.estimate);
        if !self.identification.has_body()
            || invalid.any_of(Validity::FEET_OFF_PLATE.and(Validity::COP_NOT_MEASURED))
        {
            return;
        }
        let loaded = !invalid.any_of(Validity::BELOW_LOAD_THRESHOLD);
        if !invalid.any_of(Validity::LOAD_BELOW_DETECTION_LIMIT) {
            self.update_back(pose, body, settings, loaded);
        }
        if loaded {
            self.update_load(pose, body, settings, &magnitude_nm);
        }
    }

    /// Publishes the exposure accumulated over the subject's shift.
    pub(super) fn publish_exposure(&mut self) {
        self.estimate.fatigue = self.exposure.fatigue.share;
        self.estimate.dose_damage = self.exposure.dose.damage;
        self.estimate.dose_probability = dose::probability(self.exposure.dose.damage);
        self.estimate.lifts = self.exposure.dose.lifts.min(u64::from(u32::MAX)) as u32;
    }

    /// Load state by the validity flags of this sample and the state of the identification.
    fn load(
        &self,
        pose: &Pose<StationWorld>,
        body_motion: &BodyMotion,
        settings: &Settings,
        invalid: Validity,
        magnitude_nm: &[f64; JOINTS],
    ) -> Load {
        let subject = &self.identification;
        let weighed = subject.mass_kg > 0.0;
        if invalid == Validity::BELOW_LOAD_THRESHOLD && weighed {
            return Load::None;
        }
        let since_change_ns = self.estimate.suit_sample_time_ns.saturating_sub(self.model_changed_ns);
        let changed = self.model_changed_ns > 0 && since_change_ns < MODEL_CHANGED_NS;
        let is_identified = weighed && subject.has_body() && subject.identified == 1 && !changed;
        if !is_identified || invalid.any_of(Validity::INVALIDATES_TORQUES) {
            return Load::Unknown;
        }
        let hips = [Segment::LeftUpperLeg, Segment::RightUpperLeg].map(|leg| pose.origin_of(leg));
        let mass_kg = self.carried_kg(body_motion, settings);
        let carried = Carried { mass_kg, distance_m: self.horizontal_load_distance_m(hips) };
        Load::Known { torque_nm: *magnitude_nm, carried }
    }

    /// Mass of the load and its 1-σ, kg. Valid while a load is detected.
    fn carried_kg(&self, body_motion: &BodyMotion, settings: &Settings) -> [f64; 2] {
        let sigma_n = self.estimate.delta_f_sigma_n.max(settings.force_sigma_n);
        lift::lifted_mass_kg(self.estimate.delta_f_n[2], sigma_n, body_motion.load_weight_m_per_s2())
    }

    /// Horizontal distance of the load from the middle of two joints, m.
    fn horizontal_load_distance_m(&self, joints: [Vector3<f64>; 2]) -> f64 {
        let middle = 0.5 * (joints[0] + joints[1]);
        math::hypot([self.load_point_m[0] - middle.x, self.load_point_m[1] - middle.y])
    }

    fn update_back(
        &mut self,
        pose: &Pose<StationWorld>,
        body_motion: &BodyMotion,
        settings: &Settings,
        loaded: bool,
    ) {
        let subject = &self.identification;
        let (mass_kg, weight_n) = (subject.mass_kg, subject.mass_kg * GRAVITY_M_PER_S2);
        let above = |segment: Segment| segment.is_distal_to(L5S1.segment());
        let mut phi = subject.phi();
        for segment in Segment::ALL.into_iter().filter(|segment| !above(*segment)) {
            phi.0[segment.index()] = [0.0; 3];
        }
        let arm_m: Vector3<f64> =
            pose.world_from_segment.iter().zip(phi.0).map(|(turn, phi)| turn * Vector3::from(phi)).sum();
        let [inertia_x, inertia_y, _] = body_motion.upper.moment_m2_per_s2;
        let level_m = [arm_m.x - inertia_y / GRAVITY_M_PER_S2, arm_m.y + inertia_x / GRAVITY_M_PER_S2];
        let rows = subject.reduction.rows_over(pose, [0.0; 2], above);
        let parameters_m2 = subject.parameter_variance_m2(&rows.h);
        let suit_m2 = drift_variance_m2(pose, &EffectiveVectors(phi.0), settings.suit_drift_rad);
        let [inertia_x_m, inertia_y_m] =
            self.noise.upper_sigma_m2_per_s2().map(|sigma| sigma / GRAVITY_M_PER_S2);
        let inertia_m = [inertia_y_m, inertia_x_m];
        let share = distal_mass(&subject.anthropometry().mass_fraction)[L5S1.segment().index()];
        let up_n = Vector3::new(0.0, 0.0, share * weight_n);
        let mut arms: [Arm; 2] = core::array::from_fn(|axis| Arm {
            arm_m: level_m[axis],
            variance_m2: parameters_m2[axis] + suit_m2[axis] + inertia_m[axis] * inertia_m[axis],
        });
        if !loaded {
            arms = self.arms_given_cop(arms, share);
        }
        // r × W ẑ = (r_y W, −r_x W, 0): the X component results from the arm along Y.
        let [x, y] = arms;
        let body = UpperBody {
            moment_nm: [weight_n * y.arm_m, -weight_n * x.arm_m],
            variance_nm2: [y, x].map(|arm| weight_n * weight_n * arm.variance_m2),
            force_n: up_n + mass_kg * Vector3::from(body_motion.upper.force_m_per_s2),
            lumbar_axis: pose.world_from_segment[L5S1.segment().index()] * Vector3::z(),
        };
        let load = if loaded {
            let delta_f_n = self.estimate.delta_f_n[2];
            let [x, y, _] = body_motion.hands_acceleration_m_per_s2();
            let load_kg = body_motion.load_kg(delta_f_n);
            LoadAtBack {
                torque_nm: self.estimate.torque_nm[L5S1.index()].into(),
                torque_sigma_nm: self.estimate.torque_sigma_nm[L5S1.index()],
                force_n: Vector3::new(load_kg * x, load_kg * y, delta_f_n),
            }
        } else {
            LoadAtBack::NONE
        };
        let back = Back::of(&body, &load);
        self.estimate.l5s1_moment_nm = back.moment_nm;
        self.estimate.l5s1_moment_sigma_nm = back.moment_sigma_nm;
        self.estimate.l5s1_compression_n = back.compression_n;
        self.estimate.l5s1_compression_sigma_n = back.compression_sigma_n;
    }

    /// Arms of the body above L5/S1 (world x and y), conditional on the measured CoP: without a load, its distance from
    /// the estimated CoP is the error of the body model, of which the error above the joint is a part. `share` is the
    /// fraction of the model error above the joint.
    fn arms_given_cop(&self, arms: [Arm; 2], share: f64) -> [Arm; 2] {
        let misfit_m2 = self.identification.misfit_variance_m2();
        core::array::from_fn(|axis| {
            let residual_m = self.estimate.cop_measured_m[axis] - self.estimate.cop_estimated_m[axis];
            let [estimated_m, measured_m] = [self.estimate.cop_sigma_m[axis], self.ground_sigma.cop_m];
            let arm = Arm { variance_m2: arms[axis].variance_m2 + share * misfit_m2[axis], ..arms[axis] };
            let common_m2 = arm.variance_m2.min(estimated_m * estimated_m);
            arm.conditional(residual_m, estimated_m * estimated_m + measured_m * measured_m, common_m2)
        })
    }

    fn update_load(
        &mut self,
        pose: &Pose<StationWorld>,
        body_motion: &BodyMotion,
        settings: &Settings,
        magnitude_nm: &[f64; JOINTS],
    ) {
        let mass_kg = self.carried_kg(body_motion, settings);
        let ankles = Side::BOTH.map(|side| pose.origin_of(side.foot()));
        let reach_m = self.horizontal_load_distance_m(ankles);
        // In the hands, along the reach; and between ankles and hands.
        let middle = 0.5 * (ankles[0] + ankles[1]);
        let along = [0, 1].map(|axis: usize| {
            let reach = (self.load_point_m[axis] - middle[axis]) / reach_m.max(1e-9);
            reach * self.load_point_sigma_m[axis]
        });
        let chain_m = self.orientation_sigma_rad(settings) * settings.height_m;
        let estimate = &mut self.estimate;
        [estimate.lifted_mass_kg, estimate.lifted_mass_sigma_kg] = mass_kg;
        estimate.reach_m = reach_m;
        estimate.reach_sigma_m = math::hypot([math::hypot(along), chain_m]);

        let delta_f_n = estimate.delta_f_n[2];
        let Some(worst) = advice::worst_joint(magnitude_nm, &estimate.torque_limit_nm) else { return };
        let index = worst.index();
        let leverage = leverage(worst, estimate.foot_load_fraction, estimate.hand_load_fraction);
        let (torque_nm, sigma_nm) = (estimate.torque_nm[index], estimate.torque_sigma_nm[index]);
        let advice = Advice::of(leverage, delta_f_n, torque_nm, sigma_nm);
        estimate.worst_joint = index as u32;
        estimate.advice_direction = advice.direction;
        estimate.advice_gain_nm_per_cm = advice.gain_nm_per_cm;
    }
}

/// Resets the values of load and back. Accumulated values stay, because they do not depend on the sensors' present
/// state.
fn mask_all(state: &mut State) {
    mask_load(state);
    mask_advice(state);
    mask_back(state);
}

fn mask_load(state: &mut State) {
    state.lifted_mass_kg = 0.0;
    state.lifted_mass_sigma_kg = 0.0;
}

fn mask_advice(state: &mut State) {
    state.reach_m = 0.0;
    state.reach_sigma_m = 0.0;
    state.worst_joint = NO_JOINT;
    state.advice_direction = [0.0; 3];
    state.advice_gain_nm_per_cm = 0.0;
}

fn mask_back(state: &mut State) {
    state.l5s1_moment_nm = 0.0;
    state.l5s1_moment_sigma_nm = 0.0;
    state.l5s1_compression_n = 0.0;
    state.l5s1_compression_sigma_n = 0.0;
}

/// Sets invalid values to zero.
pub(super) fn mask_invalid(state: &mut State) {
    let valid = state.validity();
    if valid.any_of(Validity::INVALIDATES_LIFTED_MASS) {
        mask_load(state);
    }
    if valid.any_of(Validity::INVALIDATES_TORQUES) {
        mask_advice(state);
    }
    if valid.any_of(Validity::INVALIDATES_LOW_BACK) {
        mask_back(state);
    }
}
