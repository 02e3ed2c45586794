//! Stage `early`: an estimate about the newest suit sample; the state lies half a motion window behind it.
//!
//! Accelerations are those at the end of the last window ([`causal_motion`]). What changes slowly is taken from the
//! newest state: the load's position in the hands, the force offset, the terms of the model, the presence of a load.
//! The stage updates no other stage.
//!
//! **σ.** Each early estimate is stored until the state of the same sample arrives; the variance of their difference, by
//! motion intensity ([`DifferenceVariance`]), is added to the state's variance.

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;

use super::Tick;
use super::align::AlignState;
use super::cop_estimate::Estimate;
use super::differentiate::Instant;
use super::ground::{Ground, GroundState, measure_ground};
use super::identification::{Identification, StanceSigma};
use super::identify::Identified;
use super::loading::{Carrying, ExternalForce, LoadState};
use super::outputs::Outputs;
use super::placement::Placement;
use super::prediction::{Prediction, PredictionState, predict_early};
use super::settings::{Motion, Settings};
use super::streams::Streams;
use super::validity::time_is_uncertain;
use super::{foot_outline, insoles};
use crate::body::{JOINTS, Side, gyration_m2};
use crate::math;
use crate::message::state::AccelerationSource;
use crate::message::{EarlyState, State, SuitBody, Validity};
use crate::motion::unloaded::SIGMAS_OF_A_LOAD;
use crate::motion::{
    CausalMotion, DifferenceVariance, Envelope, History, Inertia, MassDistribution, VariancePrior,
    causal_motion,
};
use crate::sesc::centre_of_mass;

/// Early estimates that wait for the state of their sample: more than a window has after its middle.
const PENDING: usize = 40;
/// Early estimates are published once this much motion was compared, s.
const COMPARED_MIN_S: f64 = 1.0;
/// Longest interval that one comparison stands for, s: two samples of the slowest suit.
const STEP_MAX_S: f64 = 0.07;

/// Variances of the difference between early estimate and state before any was measured, by the source of the
/// accelerations ([`AccelerationSource`]): `equipoise-study early`, squares of the unit.
struct Priors {
    delta_f_n2: VariancePrior,
    cop_m2: VariancePrior,
    torque_nm2: VariancePrior,
}

const BY_POSITIONS: Priors = Priors {
    delta_f_n2: VariancePrior { at_rest: 0.25, by_motion: 2.5 },
    cop_m2: VariancePrior { at_rest: 1e-7, by_motion: 1e-6 },
    torque_nm2: VariancePrior { at_rest: 0.05, by_motion: 0.2 },
};
const BY_SUIT: Priors = Priors {
    delta_f_n2: VariancePrior { at_rest: 0.25, by_motion: 1.5 },
    cop_m2: VariancePrior { at_rest: 1e-7, by_motion: 1e-6 },
    torque_nm2: VariancePrior { at_rest: 0.05, by_motion: 0.4 },
};

/// State of the stage.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct EarlyStage {
    /// The last early state.
    pub(super) published: EarlyState,
    held: Held,
    /// Recent motion intensity of the newest samples, m/s².
    intensity: Envelope,
    differences: Differences,
}

/// Slow quantities, by the newest state.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Held {
    /// Change of CoP, m, and force, N, by the model's terms.
    terms_cop_m: [f64; 2],
    terms_force_n: [f64; 3],
    /// 1-σ of the estimated CoP, world x and y, m.
    cop_sigma_m: [f64; 2],
    /// Error of the stance offset per metre of the CoP's error, per axis ([`StanceSigma::by_estimate`]).
    stance_by_estimate: [f64; 2],
    /// 1-σ of the rest of the stance offset, per axis, m.
    stance_rest_m: [f64; 2],
    /// 1-σ of the external force, N, and of the torques, N m.
    delta_f_sigma_n: f64,
    torque_sigma_nm: [f64; JOINTS],
}

/// Early estimate of one sample, without masks.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Pending {
    time_ns: u64,
    /// 1 if the torques are those of a load.
    has_torques: u64,
    /// 1 if the accelerations contain the suit's own.
    is_by_suit: u64,
    intensity_m_per_s2: f64,
    delta_f_n: f64,
    cop_m: [f64; 2],
    torque_nm: [f64; JOINTS],
}

/// Differences between early estimates and states.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Differences {
    pending: [Pending; PENDING],
    /// Index of the next entry, in [0, PENDING).
    next: u64,
    /// Duration compared so far, s, up to [`COMPARED_MIN_S`].
    compared_s: f64,
    delta_f: DifferenceVariance,
    cop: [DifferenceVariance; 2],
    torque: [DifferenceVariance; JOINTS],
}

/// State of the other stages after a cycle.
pub(super) struct Newest<'a> {
    pub(super) history: &'a History,
    pub(super) align: &'a AlignState,
    pub(super) placement: &'a Placement,
    pub(super) subject: &'a Identification,
    pub(super) suit_body: Option<&'a SuitBody>,
    pub(super) ground: &'a GroundState,
    pub(super) prediction: &'a PredictionState,
    pub(super) load: &'a LoadState,
    pub(super) streams: &'a Streams,
    pub(super) state: &'a State,
    pub(super) tick: Tick,
}

impl EarlyStage {
    /// Drops the estimates that wait for their state: they belong to another body, place or model.
    pub(super) fn clear_pending(&mut self) {
        self.differences.pending = Zeroable::zeroed();
    }

    /// Resets the measured differences: they were measured with the previous differentiation.
    pub(super) fn reset_differences(&mut self) {
        self.differences = Zeroable::zeroed();
    }

    /// Whether every index and number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        let Differences { pending, next, compared_s, delta_f, cop, torque } = &self.differences;
        let held = &self.held;
        let numbers = held.terms_cop_m.iter().chain(&held.terms_force_n).chain(&held.cop_sigma_m);
        let numbers = numbers.chain(&held.stance_by_estimate).chain(&held.stance_rest_m);
        numbers.chain([&held.delta_f_sigma_n]).chain(&held.torque_sigma_nm).all(|number| number.is_finite())
            && crate::message::Message::is_finite(&self.published)
            && self.intensity.is_sound()
            && pending.iter().all(|pending| {
                let numbers = [pending.intensity_m_per_s2, pending.delta_f_n];
                let mut numbers = numbers.iter().chain(&pending.cop_m).chain(&pending.torque_nm);
                numbers.all(|number| number.is_finite())
            })
            && *next < PENDING as u64
            && (0.0..=COMPARED_MIN_S).contains(compared_s)
            && cop.iter().chain(torque).chain([delta_f]).all(DifferenceVariance::is_sound)
    }

    /// Holds the slow quantities of an instant, and compares its results with the early estimate of the same sample.
    pub(super) fn ingest(&mut self, outputs: &Outputs<'_>, subject: Identified<'_>) {
        let Outputs { instant, prediction, estimate, overload, .. } = outputs;
        let held = &mut self.held;
        // Without a mass some σ are infinite, and nothing is valid.
        if subject.mass_kg <= 0.0 {
            *held = Zeroable::zeroed();
            return;
        }
        (held.terms_cop_m, held.terms_force_n) = (prediction.terms_cop_m, prediction.terms_force_n);
        held.cop_sigma_m = estimate.cop_sigma_m;
        let StanceSigma { by_estimate, rest_m } = estimate.stance;
        (held.stance_by_estimate, held.stance_rest_m) = (by_estimate, rest_m);
        held.delta_f_sigma_n = prediction.delta_f_sigma_n;
        if let Some(load) = overload.and_then(|overload| overload.load.as_ref()) {
            held.torque_sigma_nm = load.torques.map(|torque| torque.sigma_nm);
        }
        // Before the end of the identification, differences belong to another model.
        if subject.identified == 1 {
            self.differences.compare(outputs, instant.step_s.clamp(0.0, STEP_MAX_S));
        }
    }
}

impl Differences {
    fn push(&mut self, pending: Pending) {
        self.pending[self.next as usize % PENDING] = pending;
        self.next = (self.next + 1) % PENDING as u64;
    }

    /// Updates the variances by the results of an instant, if it has an early estimate and both are valid.
    fn compare(&mut self, outputs: &Outputs<'_>, step_s: f64) {
        let time_ns = outputs.instant.snapshot.time_ns;
        let Some(early) = self.pending.iter().find(|early| early.time_ns == time_ns) else { return };
        let (invalid, intensity) = (outputs.withheld.reasons(), early.intensity_m_per_s2);
        let Some(overload) = outputs.overload else { return };
        if invalid.any_of(Validity::INVALIDATES_DELTA_F.and(Validity::INVALIDATES_COP_ESTIMATED)) {
            return;
        }
        let priors = priors(early.is_by_suit == 1);
        let difference_n = early.delta_f_n - overload.delta_f_n;
        self.delta_f.update(difference_n, intensity, step_s, &priors.delta_f_n2);
        for (axis, variance) in self.cop.iter_mut().enumerate() {
            let difference_m = early.cop_m[axis] - outputs.estimate.cop_m[axis];
            variance.update(difference_m, intensity, step_s, &priors.cop_m2);
        }
        self.compared_s = (self.compared_s + step_s).min(COMPARED_MIN_S);
        let load = overload.load.as_ref().filter(|_| early.has_torques == 1);
        if let Some(load) = load.filter(|_| !invalid.any_of(Validity::INVALIDATES_TORQUES)) {
            let both = early.torque_nm.iter().zip(&load.torques);
            for (variance, (early_nm, torque)) in self.torque.iter_mut().zip(both) {
                let difference_nm = early_nm - torque.torque_nm.norm();
                variance.update(difference_nm, intensity, step_s, &priors.torque_nm2);
            }
        }
    }

    fn is_calibrated(&self) -> bool {
        self.compared_s >= COMPARED_MIN_S
    }
}

fn priors(is_by_suit: bool) -> &'static Priors {
    if is_by_suit { &BY_SUIT } else { &BY_POSITIONS }
}

/// Estimates about the newest sample, once per sample; between samples only raises the flags that the state raises.
pub(super) fn estimate_early(settings: &Settings, stage: &mut EarlyStage, newest: &Newest<'_>) {
    let last_ns = stage.published.sample_time_ns;
    let sample = newest.history.newest().filter(|snapshot| snapshot.time_ns > last_ns);
    let Some(snapshot) = sample else {
        let published = &mut stage.published;
        let valid = published.validity().and(newest.state.validity());
        if valid.0 != published.valid {
            published.valid = valid.0;
            published.stamp(newest.tick);
            published.mask_invalid();
        }
        return;
    };
    let step_s = snapshot.time_ns.saturating_sub(last_ns) as f64 * 1e-9;
    let early = Early::of(settings, stage, newest, step_s);
    stage.published = early.state(stage, newest);
    let torque_nm = early.torque_nm.map_or([0.0; JOINTS], |torques| torques.map(|torque| torque.norm()));
    // Without a mass the estimate is not finite, and no state will be compared with it.
    if early.motion.is_some() && newest.subject.mass_kg > 0.0 {
        stage.differences.push(Pending {
            time_ns: early.instant.snapshot.time_ns,
            has_torques: u64::from(early.torque_nm.is_some()),
            is_by_suit: u64::from(early.is_by_suit()),
            intensity_m_per_s2: stage.intensity.height(),
            delta_f_n: early.delta_f_n,
            cop_m: early.estimate.cop_m,
            torque_nm,
        });
    }
}

/// Results at the newest sample.
struct Early {
    instant: Instant,
    ground: Ground,
    motion: Option<CausalMotion>,
    estimate: Estimate,
    delta_f_n: f64,
    /// Torques of a load that the state has detected.
    torque_nm: Option<[Vector3<f64>; JOINTS]>,
    invalid: Validity,
}

impl Early {
    fn of(settings: &Settings, stage: &mut EarlyStage, newest: &Newest<'_>, step_s: f64) -> Early {
        let Newest { subject, streams, state, .. } = *newest;
        let (instant, motion) = newest_instant(settings, newest);
        let ground = measure_ground(settings, &mut newest.ground.clone(), &instant, subject, streams);
        let inertia = match (settings.motion, instant.inertia) {
            (Motion::Paper, Some(_)) => Some(Inertia::REST),
            (_, Some(inertia)) if inertia.is_moderate() => Some(inertia),
            _ => None,
        };
        let mut invalid = ground.invalid.and(state.validity());
        invalid.raise(Validity::MOVING, inertia.is_none() || !stage.differences.is_calibrated());
        invalid.raise(Validity::CLOCK_UNSYNCHRONISED, time_is_uncertain(&instant.snapshot));
        let inertia = inertia.unwrap_or(Inertia::REST);
        stage.intensity.update(intensity_m_per_s2(&inertia), step_s);
        let terms = (stage.held.terms_cop_m, stage.held.terms_force_n);
        let noise = &newest.prediction.noise;
        let prediction = predict_early(settings, noise, &instant, &ground, &inertia, subject, terms);
        let estimate = stage.held.estimate(&instant, &prediction, subject);
        let vertical_n = ground.reading.force_n[2];
        let unloaded_n = ground.unloaded_force_n(subject, prediction.body.specific_force_m_per_s2);
        let delta_f_n = vertical_n - unloaded_n - prediction.terms_force_n[2];
        let mut early = Early { instant, ground, motion, estimate, delta_f_n, torque_nm: None, invalid };
        let sigma_n = early.delta_f_sigma_n(stage);
        let limit_n = settings.load_threshold_n.max(SIGMAS_OF_A_LOAD * sigma_n);
        let is_loaded = !state.validity().any_of(Validity::BELOW_LOAD_THRESHOLD);
        early.invalid.raise(Validity::LOAD_BELOW_DETECTION_LIMIT, is_loaded && delta_f_n < limit_n);
        let needed = Validity::INVALIDATES_COP_MEASURED
            .and(Validity::INVALIDATES_COM)
            .and(Validity::BELOW_LOAD_THRESHOLD)
            .and(Validity::LOAD_BELOW_DETECTION_LIMIT)
            .and(Validity::WEIGHT_MISSING);
        if subject.has_body() && !early.invalid.any_of(needed) {
            let carrying = Carrying {
                instant: &early.instant,
                ground: &early.ground,
                prediction: &prediction,
                estimate: &early.estimate,
                subject: Identified::newest(subject),
                force: ExternalForce { vertical_n, delta_f_n, sigma_n },
            };
            early.torque_nm = Some(carrying.torque_vectors(settings, newest.load));
        }
        early
    }

    fn is_by_suit(&self) -> bool {
        self.motion.is_some_and(|motion| motion.inertia.is_by_suit)
    }

    /// 1-σ of the external force: the state's, and that of the difference.
    fn delta_f_sigma_n(&self, stage: &EarlyStage) -> f64 {
        let prior = &priors(self.is_by_suit()).delta_f_n2;
        with_difference(stage.held.delta_f_sigma_n, &stage.differences.delta_f, stage, prior)
    }

    /// The message, with invalid values masked.
    fn state(&self, stage: &EarlyStage, newest: &Newest<'_>) -> EarlyState {
        let (Differences { cop, torque, .. }, held) = (&stage.differences, &stage.held);
        let (priors, state) = (priors(self.is_by_suit()), newest.state);
        let mut early = EarlyState {
            sample_time_ns: self.instant.snapshot.time_ns,
            valid: self.invalid.0,
            acceleration_source: match self.is_by_suit() {
                true => AccelerationSource::Suit as u32,
                false => AccelerationSource::Positions as u32,
            },
            calibrated: u32::from(stage.differences.is_calibrated()),
            com_m: self.estimate.com_m,
            cop_estimated_m: self.estimate.cop_m,
            cop_sigma_m: [0, 1]
                .map(|axis| with_difference(held.cop_sigma_m[axis], &cop[axis], stage, &priors.cop_m2)),
            delta_f_n: [0.0, 0.0, self.delta_f_n],
            delta_f_sigma_n: self.delta_f_sigma_n(stage),
            lifted_mass_kg: state.lifted_mass_kg,
            lifted_mass_sigma_kg: state.lifted_mass_sigma_kg,
            ..Zeroable::zeroed()
        };
        let (pose, table) = (&self.estimate.on_plate, newest.subject.anthropometry());
        early.hand_m = Side::BOTH.map(|side| pose.point_on(side.hand(), table.grip_m(side.hand())).into());
        if let Some(motion) = &self.motion {
            early.hand_velocity_m_per_s = motion.hand_velocity_m_per_s;
        }
        if let Some(torques) = &self.torque_nm {
            early.torque_nm = torques.map(Into::into);
            early.torque_sigma_nm = core::array::from_fn(|joint| {
                with_difference(held.torque_sigma_nm[joint], &torque[joint], stage, &priors.torque_nm2)
            });
        }
        early.stamp(newest.tick);
        early.mask_invalid();
        early
    }
}

impl EarlyState {
    fn stamp(&mut self, tick: Tick) {
        (self.cycle, self.time_ns) = (tick.cycle, tick.due_ns);
        self.sample_age_ns = tick.due_ns.saturating_sub(self.sample_time_ns);
    }
}

/// σ of an early estimate: the state's, and that of the difference in the present motion.
fn with_difference(
    sigma: f64,
    difference: &DifferenceVariance,
    stage: &EarlyStage,
    prior: &VariancePrior,
) -> f64 {
    math::sqrt(sigma * sigma + difference.variance(stage.intensity.height(), prior))
}

/// Acceleration of the centre of mass, with the rotation about it as that of a point at 1 m, m/s².
fn intensity_m_per_s2(inertia: &Inertia) -> f64 {
    let [x, y, z] = inertia.acceleration_m_per_s2;
    let [turning_x, turning_y, _] = inertia.momentum_rate_m2_per_s2;
    math::hypot([math::hypot([x, y]), math::hypot([z, math::hypot([turning_x, turning_y])])])
}

/// The newest sample with the accelerations at the end of its window, and the wrench that belongs to them.
fn newest_instant(settings: &Settings, newest: &Newest<'_>) -> (Instant, Option<CausalMotion>) {
    let Newest { history, align, placement, subject, suit_body, .. } = *newest;
    let mut snapshot = history.newest().copied().unwrap_or_else(Zeroable::zeroed);
    let pose = snapshot.pose();
    let gyration_m2 = gyration_m2(&subject.skeleton(), settings.height_m);
    let masses = MassDistribution { body: subject.anthropometry(), gyration_m2: &gyration_m2 };
    let grip_m = Side::BOTH.map(|side| Vector3::from(masses.body.grip_m(side.hand())));
    let span_ns = 2 * settings.half_window_ns();
    let motion = causal_motion(history, span_ns, settings.accelerations, &masses, grip_m);
    snapshot.time_sigma_ns = motion.map_or(snapshot.time_sigma_ns, |motion| motion.inertia.time_sigma_ns);
    if let Some(motion) = motion.filter(|motion| !motion.inertia.is_by_suit)
        && settings.motion != Motion::Paper
        && let Some(time_ns) = snapshot.ground().map(|ground| ground.sample_time_ns)
        && let Some(ground) = align.alignment.ground_before(time_ns, motion.span_ns)
    {
        let outlines = foot_outline::both(&pose, suit_body, settings.height_m);
        snapshot.ground = insoles::to_world(&ground, &pose, &outlines);
    }
    let instant = Instant {
        snapshot,
        pose,
        inertia: motion.map(|motion| motion.inertia),
        step_s: 0.0,
        suit_body: suit_body.copied(),
        place_is_lost: placement.registration.is_lost(),
        heading_sigma_rad: placement.registration.heading_sigma_rad(),
    };
    (instant, motion)
}

impl Held {
    /// Centre of mass and centre of pressure at the newest sample, with the state's σ.
    fn estimate(&self, instant: &Instant, prediction: &Prediction, subject: &Identification) -> Estimate {
        let (pose, body, offset_m) = (&instant.pose, &prediction.body, subject.stance_offset_m());
        let rows = subject.reduction.rows(pose, body.slope);
        let static_m = subject.predict_cop_m(&rows);
        let [x, y] = offset_m;
        let has_body = subject.has_body();
        let com_m = centre_of_mass(pose, &subject.phi()) + Vector3::new(x, y, 0.0);
        let cop_m =
            [0, 1].map(|axis| static_m[axis] + body.cop_beyond_rows_m(axis) + prediction.terms_cop_m[axis]);
        Estimate {
            com_m: if has_body { com_m.into() } else { [0.0; 3] },
            cop_m: if has_body { cop_m } else { [0.0; 2] },
            cop_sigma_m: self.cop_sigma_m,
            stance: StanceSigma { by_estimate: self.stance_by_estimate, rest_m: self.stance_rest_m },
            offset_m,
            on_plate: pose.displaced(offset_m),
        }
    }
}
