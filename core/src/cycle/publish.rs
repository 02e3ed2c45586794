//! Stage `publish`: assembles the published state from the outputs of the stages, and masks invalid values.

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;

use super::align::{AlignState, suit_latency_ns, wait_max_ns};
use super::exposure::InstantExposure;
use super::ground::{GroundAlone, Reading};
use super::identification::Identification;
use super::loading::CarriedLoad;
use super::model_terms::ModelTerms;
use super::outputs::Outputs;
use super::reported_body::ReportedBody;
use super::settings::Settings;
use super::streams::Streams;
use super::{MODEL_CHANGED_NS, NO_JOINT, STALE_TOLERANCE_NS, Tick};
use crate::body::JOINTS;
use crate::exposure::{Exposure, dose};
use crate::message::state::{Phase, SharingSource, Unavailable};
use crate::message::{State, Validity};
use crate::overload::{Level, Levels};

/// State of the stage.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Publication {
    /// Values of the newest instant, whether valid or not.
    pub(super) estimate: State,
    /// Its invalid reasons: [`Validity`] bits.
    invalid: u64,
    /// 1 once both streams and the subject were ready together.
    was_ready: u64,
    /// The last published levels.
    levels: Levels,
}

/// Ages of both streams.
#[derive(Debug, Clone, Copy)]
pub(super) struct Freshness {
    suit_age_ns: u64,
    ground_age_ns: u64,
    suit_is_stale: bool,
    ground_is_stale: bool,
}

impl Freshness {
    /// At the tick; `published_ns` is the time of the newest instant.
    pub(super) fn at(
        settings: &Settings,
        AlignState { alignment, .. }: &AlignState,
        terms: &ModelTerms,
        streams: &Streams,
        published_ns: u64,
        tick: Tick,
    ) -> Freshness {
        let now_ns = tick.due_ns;
        let age = |time: Option<u64>| time.map_or(u64::MAX, |time_ns| now_ns.saturating_sub(time_ns));
        let stale = |age_ns: u64, period_ns: u64| age_ns > 2 * period_ns + STALE_TOLERANCE_NS;
        let beyond = |age_ns: u64, expected_ns: u64| age_ns.saturating_sub(expected_ns);
        let suit_age_ns = age(alignment.newest_suit().map(|suit| suit.sample_time_ns));
        let ground_age_ns = age(alignment.newest_ground().map(|ground| ground.sample_time_ns));
        // The newest samples may still wait for the ground; the results belong to the samples processed so far.
        let published_age_ns = now_ns.saturating_sub(published_ns);
        let suit_period_ns = alignment.suit_period_ns();
        let waits_ns = wait_max_ns(settings, terms, streams, tick) + settings.half_window_ns();
        let arrives_after_ns = suit_latency_ns(settings, terms, tick);
        Freshness {
            suit_age_ns,
            ground_age_ns,
            suit_is_stale: stale(beyond(suit_age_ns, arrives_after_ns), suit_period_ns)
                || stale(beyond(published_age_ns, waits_ns), suit_period_ns),
            ground_is_stale: stale(
                beyond(ground_age_ns, settings.ground_latency_ns),
                alignment.ground_period_ns(),
            ),
        }
    }

    /// Whether only the ground measures.
    pub(super) fn has_ground_alone(&self) -> bool {
        self.suit_is_stale && !self.ground_is_stale
    }
}

/// What is published about a cycle besides the newest instant.
pub(super) struct Status<'a> {
    pub(super) tick: Tick,
    pub(super) freshness: Freshness,
    pub(super) streams: &'a Streams,
    pub(super) skew_s: [f64; 2],
    pub(super) subject: &'a Identification,
    pub(super) reported_body: &'a ReportedBody,
    pub(super) suggested: u64,
    pub(super) motion_samples_used: u64,
    pub(super) place_is_lost: bool,
    pub(super) model_changed_ns: u64,
}

impl Publication {
    /// Sets the flags for the time before the first instant of a subject: no value that depends on the body is valid.
    pub(super) fn start(&mut self) {
        let invalid = Validity::MOVING.and(Validity::FEET_OFF_PLATE).and(Validity::BODY_UNKNOWN);
        self.invalid = invalid.0;
    }

    /// Whether a person stands on the plate at the newest instant.
    pub(super) fn stands(&self) -> bool {
        !Validity(self.invalid).any_of(Validity::FEET_OFF_PLATE.and(Validity::COP_NOT_MEASURED))
    }

    /// Starts with another subject or shift.
    pub(super) fn begin_shift(&mut self, exposure: &Exposure) {
        self.levels.reset();
        self.hold_shift(exposure);
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.levels.is_sound()
    }

    /// Holds the exposure accumulated over the subject's shift.
    pub(super) fn hold_shift(&mut self, exposure: &Exposure) {
        self.estimate.fatigue = exposure.fatigue.by_joint;
        self.estimate.dose_damage = exposure.dose.damage;
        self.estimate.dose_probability = dose::probability(exposure.dose.damage);
        self.estimate.lifts = exposure.dose.lifts.min(u64::from(u32::MAX)) as u32;
    }

    /// Holds the values of an instant until the next one.
    pub(super) fn hold(
        &mut self,
        outputs: &Outputs<'_>,
        exposure: &InstantExposure<'_>,
        pose_mismatch_rad: f64,
        newest_suit_ns: u64,
    ) {
        let Outputs { instant, ground, stillness, estimate, overload, .. } = outputs;
        let (snapshot, state) = (&instant.snapshot, &mut self.estimate);
        hold_reading(state, &ground.reading);
        set_unavailable(state, Unavailable::SuitCom, snapshot.has_suit_com != 1);
        state.suit_sample_time_ns = snapshot.time_ns;
        state.group_delay_ns = newest_suit_ns.saturating_sub(snapshot.time_ns);
        state.stance = snapshot.stance as u32;
        state.cop_measured_sigma_m = [ground.sigma.cop_m; 2];
        state.static_pose = u32::from(stillness.is_static);
        state.acceleration_source = stillness.source() as u32;
        state.pose_mismatch_rad = pose_mismatch_rad;
        state.com_m = estimate.com_m;
        state.cop_estimated_m = estimate.cop_m;
        state.cop_sigma_m = estimate.cop_sigma_m;
        state.segment_origin_m = estimate.on_plate.origin.map(Into::into);
        let ([x, y, z], [dx, dy]) = (snapshot.suit_com_m, estimate.offset_m);
        state.suit_com_m = [x + dx, y + dy, z];
        if let Some(overload) = overload {
            state.delta_f_n = [0.0, 0.0, overload.delta_f_n];
            state.delta_f_sigma_n = overload.delta_f_sigma_n;
        }
        mask_torques(state);
        if let Some(load) = overload.and_then(|overload| overload.load.as_ref()) {
            hold_load(state, load);
        }
        hold_exposure(state, exposure);
        self.hold_shift(exposure.shift);
        self.invalid = outputs.withheld.reasons().0;
    }

    /// Holds the ground measurement while the suit is silent.
    pub(super) fn hold_ground_alone(&mut self, alone: &GroundAlone) {
        hold_reading(&mut self.estimate, &alone.reading);
        self.estimate.cop_measured_sigma_m = [alone.cop_sigma_m; 2];
        self.estimate.delta_f_n = [0.0, 0.0, alone.delta_f_n];
        self.invalid = alone.invalid.0;
    }

    /// Publishes the state of a cycle: values of the newest instant, ages, phase and validity flags; invalid values are
    /// zero.
    pub(super) fn publish(&mut self, settings: &Settings, published: &mut State, status: &Status<'_>) {
        // The plate may have recovered, but the current snapshot predates the recovery.
        let ground_is_stale =
            status.freshness.ground_is_stale || Validity(self.invalid).any_of(Validity::GROUND_STALE);
        let is_stale = status.freshness.suit_is_stale || ground_is_stale;
        let valid = self.validity(status, ground_is_stale);
        let phase = self.phase(status.subject, is_stale);
        if is_stale {
            self.estimate.static_pose = 0;
        }
        let (state, subject) = (&mut self.estimate, status.subject);
        state.valid = valid.0;
        state.phase = phase as u32;
        state.cycle = status.tick.cycle;
        state.time_ns = status.tick.due_ns;
        state.suit_age_ns = status.freshness.suit_age_ns;
        state.ground_age_ns = status.freshness.ground_age_ns;
        [state.suit_skew_s, state.suit_skew_sigma_s] = status.skew_s;
        state.body_source = subject.body_source() as u32;
        state.foot_outline_source = status.reported_body.foot_outline_source() as u32;
        state.body_rejected = status.reported_body.refused();
        state.converged = subject.identified as u32;
        state.poses_used = subject.poses_used.min(u64::from(u32::MAX)) as u32;
        state.motion_samples_used = status.motion_samples_used.min(u64::from(u32::MAX)) as u32;
        state.suggested_pose = u32::try_from(status.suggested).unwrap_or(u32::MAX);
        state.mass_kg = subject.mass_kg;
        state.variance_max_m2 = subject.filter.variance_max_m2();
        state.predicted_cop_sigma_m = subject.predicted_cop_sigma_m;
        state.nis = subject.nis;
        state.prior_inflation = subject.prior_inflation();
        *published = *state;
        mask_invalid(published, settings, &mut self.levels);
    }

    /// Validity flags at the tick.
    fn validity(&self, status: &Status<'_>, ground_is_stale: bool) -> Validity {
        let Status { subject, streams, tick, model_changed_ns, .. } = *status;
        // Rejected samples reach no snapshot, but the published results predate them.
        let suit_is_suspect = streams.suit_suspect.overlaps(self.estimate.suit_sample_time_ns, u64::MAX);
        let mut valid = Validity(self.invalid);
        valid.raise(Validity::SUIT_STALE, status.freshness.suit_is_stale);
        valid.raise(Validity::GROUND_STALE, ground_is_stale);
        valid.raise(Validity::SUIT_IMPLAUSIBLE, suit_is_suspect);
        valid.raise(Validity::NOT_IDENTIFIED, subject.identified == 0);
        valid.raise(Validity::MASS_UNKNOWN, subject.mass_kg <= 0.0);
        valid.raise(Validity::BODY_UNKNOWN, !subject.has_body());
        let changed = model_changed_ns > 0 && tick.due_ns.saturating_sub(model_changed_ns) < MODEL_CHANGED_NS;
        valid.raise(Validity::MODEL_CHANGED, changed);
        valid.raise(Validity::POSITION_UNKNOWN, status.place_is_lost);
        valid
    }

    /// Phase at the tick.
    fn phase(&mut self, subject: &Identification, is_stale: bool) -> Phase {
        let ready = subject.has_body() && subject.mass_kg > 0.0;
        let phase = match ready && !is_stale {
            true if subject.identified == 1 => Phase::Monitoring,
            true if subject.identifying == 1 => Phase::Identifying,
            // If no stream is silent, the subject itself is not ready, for example after a reset.
            false if self.was_ready == 1 && is_stale => Phase::Degraded,
            _ => Phase::Waiting,
        };
        if matches!(phase, Phase::Monitoring | Phase::Identifying) {
            self.was_ready = 1;
        }
        phase
    }
}

/// Holds a reading of the ground.
fn hold_reading(state: &mut State, reading: &Reading) {
    state.ground_force_n = reading.force_n;
    state.ground_devices = reading.devices as u32;
    state.cop_measured_m = reading.cop_m;
    set_unavailable(state, Unavailable::Shear, !reading.measures_shear());
}

/// Records whether the station's sensors provide a quantity.
fn set_unavailable(state: &mut State, what: Unavailable, missing: bool) {
    let others = state.unavailable & !(what as u32);
    state.unavailable = others | if missing { what as u32 } else { 0 };
}

fn hold_load(state: &mut State, load: &CarriedLoad) {
    (state.foot_load_fraction, state.foot_load_fraction_sigma) = (load.zeta, load.zeta_sigma);
    state.sharing_source = load.sharing_source as u32;
    (state.hand_load_fraction, state.hand_load_fraction_sigma) = (load.eta, load.eta_sigma);
    state.load_hand_distance_m = load.distance_m;
    for (joint, torque) in load.torques.iter().enumerate() {
        state.torque_nm[joint] = torque.torque_nm.into();
        state.torque_sigma_nm[joint] = torque.sigma_nm;
        state.torque_covariance_nm2[joint] = torque.covariance_nm2;
    }
}

fn hold_exposure(state: &mut State, exposure: &InstantExposure<'_>) {
    state.torque_limit_nm = exposure.torque_limit_nm;
    mask_mass(state);
    mask_advice(state);
    mask_back(state);
    if let Some(back) = exposure.back {
        state.l5s1_moment_nm = back.moment_nm;
        state.l5s1_moment_sigma_nm = back.moment_sigma_nm;
        state.l5s1_compression_n = back.compression_n;
        state.l5s1_compression_sigma_n = back.compression_sigma_n;
    }
    if let Some(mass_kg) = exposure.lifted_mass_kg {
        [state.lifted_mass_kg, state.lifted_mass_sigma_kg] = mass_kg;
    }
    if let Some(handling) = exposure.handling {
        (state.reach_m, state.reach_sigma_m) = (handling.reach_m, handling.reach_sigma_m);
        if let Some((joint, advice)) = handling.worst {
            state.worst_joint = joint.index() as u32;
            state.advice_direction = advice.direction;
            state.advice_gain_nm_per_cm = advice.gain_nm_per_cm;
        }
    }
}

/// Sets invalid values to zero, so that no consumer can act on values of a stale sensor.
fn mask_invalid(state: &mut State, settings: &Settings, levels: &mut Levels) {
    let valid = state.validity();
    if valid.any_of(Validity::INVALIDATES_COP_MEASURED) {
        (state.cop_measured_m, state.cop_measured_sigma_m) = ([0.0; 2], [0.0; 2]);
    }
    if valid.any_of(Validity::INVALIDATES_GROUND_FORCE) {
        (state.ground_force_n, state.ground_devices) = ([0.0; 3], 0);
    }
    if valid.any_of(Validity::INVALIDATES_POSE) {
        state.segment_origin_m = Zeroable::zeroed();
        state.pose_mismatch_rad = 0.0;
    }
    if valid.any_of(Validity::INVALIDATES_SUIT_COM) {
        state.suit_com_m = [0.0; 3];
    }
    if valid.any_of(Validity::INVALIDATES_COP_ESTIMATED) {
        state.cop_estimated_m = [0.0; 2];
        state.cop_sigma_m = [0.0; 2];
    }
    if valid.any_of(Validity::INVALIDATES_COM) {
        state.com_m = [0.0; 3];
    }
    if valid.any_of(Validity::INVALIDATES_DELTA_F) {
        (state.delta_f_n, state.delta_f_sigma_n) = ([0.0; 3], 0.0);
    }
    if valid.any_of(Validity::INVALIDATES_LIFTED_MASS) {
        mask_mass(state);
    }
    if valid.any_of(Validity::INVALIDATES_LOW_BACK) {
        mask_back(state);
    }
    if valid.any_of(Validity::INVALIDATES_TORQUES) {
        let distance_m = state.unless(Validity::INVALIDATES_LOAD_HAND_DISTANCE, state.load_hand_distance_m);
        mask_torques(state);
        state.load_hand_distance_m = distance_m.unwrap_or_default();
        mask_advice(state);
        state.torque_limit_nm = *settings.limits.without_torque_nm();
        levels.reset();
    } else {
        set_levels(state, settings, levels);
    }
}

/// Resets torques, load fractions and levels.
fn mask_torques(state: &mut State) {
    state.foot_load_fraction = [0.0; 2];
    state.sharing_source = SharingSource::Geometry as u32;
    state.hand_load_fraction = [0.0; 2];
    (state.foot_load_fraction_sigma, state.hand_load_fraction_sigma) = (0.0, 0.0);
    state.load_hand_distance_m = 0.0;
    state.torque_nm = [[0.0; 3]; JOINTS];
    state.torque_sigma_nm = [0.0; JOINTS];
    state.torque_covariance_nm2 = [[0.0; 3]; JOINTS];
    state.joint_level = [Level::None as u32; JOINTS];
}

fn mask_mass(state: &mut State) {
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

/// Sets the levels of Table I with hysteresis.
fn set_levels(state: &mut State, settings: &Settings, levels: &mut Levels) {
    for joint in 0..JOINTS {
        let (limit_nm, margin_fraction) = (state.torque_limit_nm[joint], settings.level_margin_fraction);
        let magnitude_nm = Vector3::from(state.torque_nm[joint]).norm();
        let sigma_nm = state.torque_sigma_nm[joint];
        let level = levels.next(joint, magnitude_nm, sigma_nm, limit_nm, margin_fraction);
        state.joint_level[joint] = level as u32;
    }
}
