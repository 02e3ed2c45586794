//! One step of the pipeline: converts samples and a time into a state.
//!
//! [`step`] reads no clock and accesses no state other than its arguments: two runs over the same ticks and samples
//! give byte-identical states. All mutable state is in [`Memory`], which is plain old data, so a checkpoint is a copy
//! of it.

pub mod alignment;
pub mod body_motion;
pub mod checkpoint;
mod exposure;
pub mod foot_outline;
mod ground_rates;
pub mod identification;
mod insoles;
mod lag_test;
mod loading;
pub mod memory;
mod model_terms;
pub mod monitoring;
mod plausibility;
mod pose_request;
mod registration;
pub mod reported_body;
mod residual;
pub mod settings;
pub mod skew_monitor;
pub mod stored_state;
pub mod support;
mod tare;

use alignment::WAIT_MAX_NS;

use crate::message::command::CommandKind;
use crate::message::state::Phase;
use crate::message::{GroundSample, State, SuitBody, SuitSample, Validity};
use crate::overload::Levels;
use crate::time::NS_PER_S;

pub use checkpoint::Checkpoint;
pub use identification::{BodySource, Identification, NO_POSE};
pub use memory::{Memory, SubjectState};
pub use reported_body::{BodyRejection, ReportedBody};
pub use settings::{
    Accelerations, Method, Motion, PoseChoice, PoseRequest, PriorKind, Settings, Similar, StopRule,
};
pub use stored_state::{Registration, StoredState};
pub use tare::Tare;

/// Tolerance of a stream's delay in addition to two of its periods, ns.
const STALE_TOLERANCE_NS: u64 = 20_000_000;
/// Time after a change of the model for which its torques are withheld, ns.
const MODEL_CHANGED_NS: u64 = NS_PER_S;
/// Value of [`State::worst_joint`] while no torque is published.
const NO_JOINT: u32 = u32::MAX;
/// The subject is in the suggested pose if the RMS difference of the joint angles is below this, rad.
pub const POSE_REACHED_RAD: f64 = 0.20;
/// Device time with a larger σ counts as not tied to host time, ns.
const CLOCK_SIGMA_MAX_NS: u64 = 20_000_000;

/// Number and due time of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tick {
    /// Number, from 1.
    pub cycle: u64,
    /// Due time, CLOCK_MONOTONIC.
    pub due_ns: u64,
}

/// Inputs received since the previous step.
#[derive(Debug, Clone, Copy, Default)]
pub struct Inputs<'a> {
    /// Suit samples in order of arrival.
    pub suit: &'a [SuitSample],
    /// Ground samples in order of arrival.
    pub ground: &'a [GroundSample],
    /// At most one body message of the suit; ingested before the samples.
    pub body: Option<&'a SuitBody>,
    /// At most one command, applied first.
    pub command: Option<CommandKind>,
}

/// Runs one cycle. The state is written in place and stays valid until the next step.
pub fn step<'m>(settings: &Settings, memory: &'m mut Memory, tick: Tick, inputs: Inputs<'_>) -> &'m State {
    if let Some(command) = inputs.command {
        memory.apply_command(settings, command, tick);
    }
    if let Some(body) = inputs.body {
        memory.ingest_body(body, tick.due_ns);
    }
    for sample in inputs.ground {
        // Subtract the tare first: it may contain components that this device does not measure.
        let sample = memory.tare.subtract_from(sample).mask_unmeasured();
        if memory.alignment.admits_ground(&sample, tick.due_ns) {
            if memory.validate_ground(&sample) {
                memory.skew.ingest_ground(&sample);
            }
            memory.alignment.push_ground(&sample);
        }
    }
    for sample in inputs.suit {
        let sample_time_ns = memory.terms.without_lag_ns(&settings.model, sample.sample_time_ns);
        let sample = SuitSample { sample_time_ns, ..*sample };
        if memory.alignment.admits_suit(&sample, tick.due_ns) && memory.validate_suit(&sample, settings) {
            memory.alignment.push_suit(&sample);
            memory.update_skew(&sample, settings);
        }
    }
    // Bounded: the queue holds a fixed number of samples.
    while let Some(aligned) = memory.alignment.next(tick.due_ns, memory.wait_max_ns(settings, tick)) {
        memory.ingest_aligned(settings, &aligned);
    }
    let stands = !memory.invalid_reasons().any_of(Validity::FEET_OFF_PLATE.and(Validity::COP_NOT_MEASURED));
    let published_ns = memory.estimate.suit_sample_time_ns;
    memory.identification.plan_step(published_ns, stands, memory.reported_body.body(), settings);
    memory.update_state(settings, tick);
    &memory.state
}

impl Memory {
    /// Expected age of a suit sample on arrival, ns: latency of the adapter and lag of the model.
    fn suit_latency_ns(&self, settings: &Settings, tick: Tick) -> u64 {
        let lag_s = self.terms.suit_lag_s(&settings.model, tick.due_ns);
        settings.suit_latency_ns + (lag_s.max(0.0) * 1e9) as u64
    }

    /// Age after which a suit sample is processed without a ground sample, ns.
    ///
    /// Includes the constant latencies of both streams, which delay samples but are no silence.
    fn wait_max_ns(&self, settings: &Settings, tick: Tick) -> u64 {
        let latency_ns = self.suit_latency_ns(settings, tick).max(settings.ground_latency_ns);
        WAIT_MAX_NS + latency_ns + self.alignment.ground_late_ns()
    }

    fn apply_command(&mut self, settings: &Settings, command: CommandKind, tick: Tick) {
        match command {
            CommandKind::IdentifyStart => self.identification.continue_identification(),
            CommandKind::IdentifyStop => {
                self.identification.identifying = 0;
                self.identification.identified = u64::from(self.identification.has_body());
                self.model_changed_ns = tick.due_ns;
            }
            CommandKind::IdentifyReset => {
                if self.identification.has_body() {
                    self.identification.reset_to_prior(settings);
                }
                // Samples from before the command must not update the filter again.
                self.window.clear();
                self.history.clear();
                self.unloaded.clear();
                self.pose_request.restart();
                // The measured mass may have been wrong.
                self.identification.mass_kg = settings.mass_kg.unwrap_or(0.0);
                self.identification.identifying = 1;
                self.estimate.motion_samples_used = 0;
                self.model_changed_ns = tick.due_ns;
            }
            CommandKind::Tare => {
                if self.tare() {
                    self.model_changed_ns = tick.due_ns;
                }
            }
            CommandKind::PoseSkip => {
                if !self.skip_requested_pose(settings) {
                    self.identification.skip_pose();
                }
            }
            CommandKind::UndoLift => {
                self.exposure.dose.undo_lift();
                self.publish_exposure();
            }
            // Handled by the daemon: the loop's memory does not change, or is replaced as a whole.
            CommandKind::Checkpoint | CommandKind::SubjectSave | CommandKind::SubjectDelete => {}
            CommandKind::Reload => {
                // Filters and the static pose window contain results of the previous model.
                self.terms.restart();
                self.pose_request.restart();
                self.window.clear();
                self.history.clear();
                self.unloaded.clear();
                self.model_changed_ns = tick.due_ns;
            }
            CommandKind::SubjectLoad => {
                self.pose_request.restart();
                // The window contains poses of the previous subject.
                self.window.clear();
                self.history.clear();
                self.unloaded.clear();
                self.noise = bytemuck::Zeroable::zeroed();
                self.estimate.motion_samples_used = 0;
                self.model_changed_ns = tick.due_ns;
            }
        }
    }

    /// Updates the state to the tick: ages, phase, validity flags; resets values that must not be used.
    fn update_state(&mut self, settings: &Settings, tick: Tick) {
        let now_ns = tick.due_ns;
        let age = |time: Option<u64>| time.map_or(u64::MAX, |time_ns| now_ns.saturating_sub(time_ns));
        let stale = |age_ns: u64, period_ns: u64| age_ns > 2 * period_ns + STALE_TOLERANCE_NS;
        let suit_age_ns = age(self.alignment.newest_suit().map(|suit| suit.sample_time_ns));
        let ground_age_ns = age(self.alignment.newest_ground().map(|ground| ground.sample_time_ns));
        // The newest samples may still wait for the ground; the results belong to the samples processed so far.
        let published_age_ns = now_ns.saturating_sub(self.estimate.suit_sample_time_ns);
        let beyond = |age_ns: u64, expected_ns: u64| age_ns.saturating_sub(expected_ns);
        let suit_period_ns = self.alignment.suit_period_ns();
        let wait_max_ns = self.wait_max_ns(settings, tick);
        let suit_stale = stale(beyond(suit_age_ns, self.suit_latency_ns(settings, tick)), suit_period_ns)
            || stale(beyond(published_age_ns, wait_max_ns + settings.half_window_ns()), suit_period_ns);
        let ground_stale =
            stale(beyond(ground_age_ns, settings.ground_latency_ns), self.alignment.ground_period_ns());
        if suit_stale && !ground_stale {
            self.apply_ground_alone();
        }
        // The plate may have recovered, but the current snapshot predates the recovery.
        let ground_stale = ground_stale || self.invalid_reasons().any_of(Validity::GROUND_STALE);

        // Rejected samples reach no snapshot, but the published results predate them.
        let suit_suspect = self.plausibility.suit.overlaps(self.estimate.suit_sample_time_ns, u64::MAX);

        let suggested = self.suggested(settings);
        let identification = &self.identification;
        let mut valid = self.invalid_reasons();
        valid.raise(Validity::SUIT_STALE, suit_stale);
        valid.raise(Validity::GROUND_STALE, ground_stale);
        valid.raise(Validity::SUIT_IMPLAUSIBLE, suit_suspect);
        valid.raise(Validity::NOT_IDENTIFIED, identification.identified == 0);
        valid.raise(Validity::MASS_UNKNOWN, identification.mass_kg <= 0.0);
        valid.raise(Validity::BODY_UNKNOWN, !identification.has_body());
        let changed =
            self.model_changed_ns > 0 && now_ns.saturating_sub(self.model_changed_ns) < MODEL_CHANGED_NS;
        valid.raise(Validity::MODEL_CHANGED, changed);
        valid.raise(Validity::POSITION_UNKNOWN, self.registration.is_lost());

        let ready = !valid.any_of(Validity::BODY_UNKNOWN) && identification.mass_kg > 0.0;
        let phase = match (ready && !suit_stale && !ground_stale, identification) {
            (true, subject) if subject.identified == 1 => Phase::Monitoring,
            (true, subject) if subject.identifying == 1 => Phase::Identifying,
            // If no stream is silent, the subject itself is not ready, for example after a reset.
            (false, _) if self.was_ready == 1 && (suit_stale || ground_stale) => Phase::Degraded,
            _ => Phase::Waiting,
        };
        if matches!(phase, Phase::Monitoring | Phase::Identifying) {
            self.was_ready = 1;
        }

        let state = &mut self.estimate;
        state.body_source = identification.body_source() as u32;
        state.foot_outline_source = self.reported_body.foot_outline_source() as u32;
        state.body_rejected = self.reported_body.refused();
        state.cycle = tick.cycle;
        state.time_ns = now_ns;
        state.suit_age_ns = suit_age_ns;
        state.ground_age_ns = ground_age_ns;
        state.valid = valid.0;
        state.phase = phase as u32;
        state.converged = identification.identified as u32;
        state.poses_used = identification.poses_used.min(u64::from(u32::MAX)) as u32;
        state.suggested_pose = u32::try_from(suggested).unwrap_or(u32::MAX);
        state.mass_kg = identification.mass_kg;
        state.variance_max_m2 = identification.filter.variance_max_m2();
        state.predicted_cop_sigma_m = identification.predicted_cop_sigma_m;
        state.nis = identification.nis;
        state.prior_inflation = identification.prior_inflation();
        if suit_stale || ground_stale {
            state.static_pose = 0;
        }
        self.state = self.estimate;
        mask_invalid(&mut self.state, settings, &mut self.exposure.levels);
    }
}

/// Sets invalid values to zero, so that no consumer can act on values of a stale sensor.
fn mask_invalid(state: &mut State, settings: &Settings, levels: &mut Levels) {
    let valid = state.validity();
    if valid.any_of(Validity::INVALIDATES_COP_MEASURED) {
        state.cop_measured_m = [0.0; 2];
    }
    if valid.any_of(Validity::INVALIDATES_GROUND_FORCE) {
        (state.ground_force_n, state.ground_devices) = ([0.0; 3], 0);
    }
    if valid.any_of(Validity::SUIT_STALE.and(Validity::SUIT_IMPLAUSIBLE)) {
        state.segment_origin_m = bytemuck::Zeroable::zeroed();
        state.suit_com_m = [0.0; 3];
        state.pose_mismatch_rad = 0.0;
    }
    if valid.any_of(Validity::INVALIDATES_COP_ESTIMATED) {
        state.cop_estimated_m = [0.0; 2];
        state.cop_sigma_m = [0.0; 2];
    }
    if valid.any_of(Validity::INVALIDATES_COM) {
        state.com_m = [0.0; 3];
    }
    if valid.any_of(Validity::INVALIDATES_DELTA_F) {
        state.delta_f_n = [0.0; 3];
    }
    if valid.any_of(Validity::INVALIDATES_TORQUES) {
        monitoring::mask_torques(state);
        state.torque_limit_nm = *settings.limits.without_torque_nm();
        levels.reset();
    } else {
        monitoring::set_levels(state, settings, levels);
    }
    exposure::mask_invalid(state);
}

#[cfg(test)]
mod tests;
