//! Stage `update_exposure`: load, back, fatigue, dose, advice.

use nalgebra::Vector3;

use super::MODEL_CHANGED_NS;
use super::identify::Identified;
use super::loading::{CarriedLoad, Overload};
use super::outputs::Outputs;
use super::settings::Settings;
use crate::GRAVITY_M_PER_S2;
use crate::body::{JOINTS, Joint, Segment, Side};
use crate::exposure::back::{Arm, LoadAtBack, UpperBody};
use crate::exposure::{Advice, Back, Carried, Exposure, Load, advice, lift};
use crate::math;
use crate::message::Validity;
use crate::overload::{Torque, leverage};
use crate::sesc::distal_mass;
use crate::sesc::suit_error::{EffectiveVectors, drift_variance_m2};

/// The joint between trunk and pelvis.
const L5S1: Joint = Joint::ALL[0];

/// Outputs of the earlier stages, and the subject.
struct Input<'a> {
    outputs: &'a Outputs<'a>,
    subject: Identified<'a>,
    load: Option<&'a CarriedLoad>,
    /// Whether the model changed recently.
    is_changed: bool,
}

/// Exposure at one instant.
#[derive(Clone, Copy)]
pub(super) struct InstantExposure<'a> {
    /// Exposure accumulated over the shift, this instant included.
    pub(super) shift: &'a Exposure,
    /// τ_max of each joint in the direction of its torque, N m.
    pub(super) torque_limit_nm: [f64; JOINTS],
    /// Low back; `None` where it is unavailable.
    pub(super) back: Option<Back>,
    /// Mass in the hands and its 1-σ, kg; `None` without a load.
    pub(super) lifted_mass_kg: Option<[f64; 2]>,
    /// Reach and advice; `None` without a located load.
    pub(super) handling: Option<Handling>,
}

/// Position of a load relative to the body, and advice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Handling {
    /// Horizontal distance from the middle of the ankles to the load and its 1-σ, m.
    pub(super) reach_m: f64,
    pub(super) reach_sigma_m: f64,
    /// The joint closest to its limit, and how to relieve it.
    pub(super) worst: Option<(Joint, Advice)>,
}

/// Advances the exposure to the instant.
pub(super) fn update_exposure<'a>(
    settings: &Settings,
    exposure: &'a mut Exposure,
    outputs: &Outputs<'_>,
    subject: Identified<'_>,
    model_changed_ns: u64,
) -> InstantExposure<'a> {
    let time_ns = outputs.instant.snapshot.time_ns;
    let load = outputs.overload.and_then(|overload| overload.load.as_ref());
    let is_changed = model_changed_ns > 0 && time_ns.saturating_sub(model_changed_ns) < MODEL_CHANGED_NS;
    let input = Input { outputs, subject, load, is_changed };
    let torque_nm = load.map_or([[0.0; 3]; JOINTS], |load| load.torques.map(|t| t.torque_nm.into()));
    let magnitude_nm = torque_nm.map(|torque_nm| Vector3::from(torque_nm).norm());
    let torque_limit_nm = settings.limits.along_nm(&outputs.estimate.on_plate, &torque_nm);
    exposure.advance(time_ns, &input.acting(settings, &magnitude_nm), &torque_limit_nm);

    let invalid = outputs.withheld.reasons();
    let mut values = InstantExposure {
        shift: exposure,
        torque_limit_nm,
        back: None,
        lifted_mass_kg: None,
        handling: None,
    };
    if !subject.has_body() || invalid.any_of(Validity::FEET_OFF_PLATE.and(Validity::COP_NOT_MEASURED)) {
        return values;
    }
    let loaded = !invalid.any_of(Validity::BELOW_LOAD_THRESHOLD);
    if !invalid.any_of(Validity::LOAD_BELOW_DETECTION_LIMIT) && (load.is_some() || !loaded) {
        values.back = Some(input.back(settings));
    }
    if let Some(overload) = outputs.overload.filter(|_| loaded) {
        values.lifted_mass_kg = Some(input.carried_kg(settings, overload));
        values.handling = load.map(|load| input.handling(settings, load, &magnitude_nm, &torque_limit_nm));
    }
    values
}

impl Input<'_> {
    /// Load state by the validity flags of this instant and the state of the identification.
    fn acting(&self, settings: &Settings, magnitude_nm: &[f64; JOINTS]) -> Load {
        let (subject, invalid) = (self.subject, self.outputs.withheld.reasons());
        let weighed = subject.mass_kg > 0.0;
        if invalid == Validity::BELOW_LOAD_THRESHOLD && weighed {
            return Load::None;
        }
        let is_identified = weighed && subject.has_body() && subject.identified == 1 && !self.is_changed;
        let (Some(overload), Some(load)) = (self.outputs.overload, self.load) else { return Load::Unknown };
        if !is_identified || invalid.any_of(Validity::INVALIDATES_TORQUES) {
            return Load::Unknown;
        }
        let pose = &self.outputs.estimate.on_plate;
        let hips = [Segment::LeftUpperLeg, Segment::RightUpperLeg].map(|leg| pose.origin_of(leg));
        let mass_kg = self.carried_kg(settings, overload);
        let carried = Carried { mass_kg, distance_m: horizontal_distance_m(load, hips) };
        Load::Known { torque_nm: *magnitude_nm, carried }
    }

    /// Mass of the load and its 1-σ, kg.
    fn carried_kg(&self, settings: &Settings, overload: &Overload) -> [f64; 2] {
        let sigma_n = overload.delta_f_sigma_n.max(settings.force_sigma_n);
        let weight_m_per_s2 = self.outputs.prediction.body.load_weight_m_per_s2();
        lift::lifted_mass_kg(overload.delta_f_n, sigma_n, weight_m_per_s2)
    }

    /// Moment and compression at L5/S1 of upper body and load.
    fn back(&self, settings: &Settings) -> Back {
        let (subject, motion) = (self.subject, &self.outputs.prediction.body);
        let (mass_kg, weight_n) = (subject.mass_kg, subject.mass_kg * GRAVITY_M_PER_S2);
        let fraction = distal_mass(&subject.anthropometry().mass_fraction)[L5S1.segment().index()];
        let up_n = Vector3::new(0.0, 0.0, fraction * weight_n);
        let mut arms = self.arms(settings);
        if self.load.is_none() {
            arms = self.arms_given_cop(arms, fraction);
        }
        // r × W ẑ = (r_y W, −r_x W, 0): the X component results from the arm along Y.
        let [x, y] = arms;
        let body = UpperBody {
            moment_nm: [weight_n * y.arm_m, -weight_n * x.arm_m],
            variance_nm2: [y, x].map(|arm| weight_n * weight_n * arm.variance_m2),
            force_n: up_n + mass_kg * Vector3::from(motion.upper.force_m_per_s2),
            lumbar_axis: self.outputs.estimate.on_plate.world_from_segment[L5S1.segment().index()]
                * Vector3::z(),
        };
        let load = self.outputs.overload.zip(self.load).map_or(LoadAtBack::NONE, |(overload, load)| {
            let [x, y, _] = motion.hands_acceleration_m_per_s2();
            let load_kg = motion.load_kg(overload.delta_f_n);
            let Torque { torque_nm, sigma_nm, .. } = load.torques[L5S1.index()];
            LoadAtBack {
                torque_nm,
                torque_sigma_nm: sigma_nm,
                force_n: Vector3::new(load_kg * x, load_kg * y, overload.delta_f_n),
            }
        });
        Back::of(&body, &load)
    }

    /// Arms of the body above L5/S1, world x and y.
    fn arms(&self, settings: &Settings) -> [Arm; 2] {
        let (pose, subject) = (&self.outputs.estimate.on_plate, self.subject);
        let above = |segment: Segment| segment.is_distal_to(L5S1.segment());
        let mut phi = subject.phi();
        for segment in Segment::ALL.into_iter().filter(|segment| !above(*segment)) {
            phi.0[segment.index()] = [0.0; 3];
        }
        let arm_m: Vector3<f64> =
            pose.world_from_segment.iter().zip(phi.0).map(|(turn, phi)| turn * Vector3::from(phi)).sum();
        let [inertia_x, inertia_y, _] = self.outputs.prediction.body.upper.moment_m2_per_s2;
        let level_m = [arm_m.x - inertia_y / GRAVITY_M_PER_S2, arm_m.y + inertia_x / GRAVITY_M_PER_S2];
        let rows = subject.reduction.rows_over(pose, [0.0; 2], above);
        let parameters_m2 = subject.parameter_variance_m2(&rows.h);
        let suit_m2 = drift_variance_m2(pose, &EffectiveVectors(phi.0), settings.suit_drift_rad);
        let [inertia_x_m, inertia_y_m] =
            self.outputs.prediction.sigma.upper_m2_per_s2.map(|sigma| sigma / GRAVITY_M_PER_S2);
        let inertia_m = [inertia_y_m, inertia_x_m];
        core::array::from_fn(|axis| Arm {
            arm_m: level_m[axis],
            variance_m2: parameters_m2[axis] + suit_m2[axis] + inertia_m[axis] * inertia_m[axis],
        })
    }

    /// Arms of the body above L5/S1 (world x and y), conditional on the measured CoP: without a load, its distance from
    /// the estimated CoP is the error of the body model, of which the error above the joint is a part. `fraction` is that
    /// of the model error above the joint.
    fn arms_given_cop(&self, arms: [Arm; 2], fraction: f64) -> [Arm; 2] {
        let misfit_m2 = self.subject.misfit_variance_m2();
        core::array::from_fn(|axis| {
            let residual_m = self.outputs.ground.reading.cop_m[axis] - self.outputs.estimate.cop_m[axis];
            let [estimated_m, measured_m] =
                [self.outputs.estimate.cop_sigma_m[axis], self.outputs.ground.sigma.cop_m];
            let arm = Arm { variance_m2: arms[axis].variance_m2 + fraction * misfit_m2[axis], ..arms[axis] };
            let common_m2 = arm.variance_m2.min(estimated_m * estimated_m);
            arm.conditional(residual_m, estimated_m * estimated_m + measured_m * measured_m, common_m2)
        })
    }

    /// Reach of a load, and advice for the joint closest to its limit.
    fn handling(
        &self,
        settings: &Settings,
        load: &CarriedLoad,
        magnitude_nm: &[f64; JOINTS],
        limit_nm: &[f64; JOINTS],
    ) -> Handling {
        let ankles = Side::BOTH.map(|side| self.outputs.estimate.on_plate.origin_of(side.foot()));
        let reach_m = horizontal_distance_m(load, ankles);
        // In the hands, along the reach; and between ankles and hands.
        let middle = 0.5 * (ankles[0] + ankles[1]);
        let along = [0, 1].map(|axis: usize| {
            let reach = (load.point_m[axis] - middle[axis]) / reach_m.max(1e-9);
            reach * load.point_sigma_m[axis]
        });
        let chain_m = self.outputs.instant.orientation_sigma_rad(settings) * settings.height_m;
        let worst = advice::worst_joint(magnitude_nm, limit_nm).zip(self.outputs.overload).map(
            |(joint, overload)| {
                let leverage = leverage(joint, load.zeta, load.eta);
                let Torque { torque_nm, sigma_nm, .. } = load.torques[joint.index()];
                (joint, Advice::of(leverage, overload.delta_f_n, torque_nm.into(), sigma_nm))
            },
        );
        Handling { reach_m, reach_sigma_m: math::hypot([math::hypot(along), chain_m]), worst }
    }
}

/// Horizontal distance of the load from the middle of two joints, m.
fn horizontal_distance_m(load: &CarriedLoad, joints: [Vector3<f64>; 2]) -> f64 {
    let middle = 0.5 * (joints[0] + joints[1]);
    math::hypot([load.point_m[0] - middle.x, load.point_m[1] - middle.y])
}
