//! One step of the pipeline: converts samples and a time into a state.
//!
//! [`step`] reads no clock and accesses no state other than its arguments: two runs over the same ticks and samples
//! give byte-identical states. All mutable state is in [`Memory`], which is plain old data, so a checkpoint is a copy
//! of it.
//!
//! Each stage is a module with a function of the settings, its own state and the outputs of the stages before it:
//! `align` → `placement` (anchor) → `differentiate` → `ground` → `stillness` → `pose_request` → `prediction` →
//! `identify` (mass) → `cop_estimate` → `identify` (static pose) → `loading` (overload) → `lag_test` → `validity` →
//! `exposure` → `residual` → `registration`, `identify` (motion) → `publish` → `early`. No stage writes the state of another: what
//! one concludes about another, such as a new registration, is an output that this module hands to its owner.

mod align;
pub mod alignment;
pub mod body_motion;
pub mod checkpoint;
mod commands;
mod cop_estimate;
mod differentiate;
mod early;
mod exposure;
pub mod foot_outline;
mod ground;
pub mod identification;
mod identify;
mod insoles;
mod lag_test;
mod load_after_gap;
mod load_in_hands;
mod loading;
pub mod memory;
mod model_terms;
mod outputs;
mod placement;
mod plausibility;
mod pose_request;
mod prediction;
mod publish;
mod registration;
pub mod reported_body;
mod residual;
pub mod settings;
pub mod skew_monitor;
mod stillness;
pub mod stored_state;
mod streams;
pub mod support;
mod tare;
mod validity;

use align::{align, ingest};
use alignment::Aligned;
use cop_estimate::{estimate_cop, weight_agreement};
use differentiate::{Instant, differentiate};
use early::{Newest, estimate_early};
use exposure::update_exposure;
use ground::{measure_ground, measure_ground_alone};
use identify::{MotionInput, update_from_motion, update_from_static_pose, weigh};
use lag_test::test_lag;
use loading::overload;
use outputs::Outputs;
use placement::{Continuity, anchor, follow};
use pose_request::compare_with_suggestion;
use prediction::predict_unloaded;
use publish::{Freshness, Status};
use registration::register;
use reported_body::{BoneUpdate, validate_body};
use residual::{Residual, residual};
use skew_monitor::LagChange;
use stillness::detect_static;
use streams::Streams;
use validity::validate;

use crate::message::command::CommandKind;
use crate::message::{GroundSample, State, SuitBody, SuitSample};
use crate::motion::Snapshot;
use crate::time::NS_PER_S;

pub use checkpoint::Checkpoint;
pub use identification::{BodySource, Identification, NO_POSE};
pub use memory::{Memory, SubjectState};
pub use reported_body::{BodyRejection, ReportedBody};
pub use settings::{
    Accelerations, Method, Motion, POSE_REQUESTS_MAX, PoseChoice, PoseRequest, PriorKind, Settings, Similar,
    StopRule,
};
pub use stored_state::{Registration, StoredForceOffset, StoredState};
pub use tare::Tare;

/// Tolerance of a stream's delay in addition to two of its periods, ns.
const STALE_TOLERANCE_NS: u64 = 20_000_000;
/// Time after a change of the model for which its torques are withheld, ns.
const MODEL_CHANGED_NS: u64 = NS_PER_S;
/// Value of [`State::worst_joint`] while no torque is published.
const NO_JOINT: u32 = u32::MAX;
/// The subject is in the suggested pose if the RMS difference of the joint angles is below this, rad.
pub const POSE_REACHED_RAD: f64 = 0.20;
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
///
/// A person of 75 kg in the T-pose is weighed within four seconds:
///
/// ```
/// use bytemuck::Zeroable;
/// use equipoise_core::GRAVITY_M_PER_S2;
/// use equipoise_core::body::{SEGMENTS, Skeleton};
/// use equipoise_core::cycle::{Inputs, Memory, Settings, Tick, step};
/// use equipoise_core::message::{GroundSample, SuitSample};
///
/// let settings = Settings::for_height(1.77);
/// let mut memory = bytemuck::zeroed_box::<Memory>();
/// memory.start(&settings);
/// let t_pose_m = Skeleton::nominal(1.77).t_pose_m().map(|[x, y, z]| [x, y, z + 0.95]);
/// for cycle in 1..=4000 {
///     let (time_ns, due_ns) = (cycle * 1_000_000, cycle * 1_000_000 + 500_000);
///     // Real sensors are noisy: a plate that repeats a value is classified as frozen.
///     let noise = 1e-9 * (cycle % 2) as f64;
///     let ground = GroundSample {
///         sample_time_ns: time_ns,
///         sequence: cycle,
///         force_n: [noise, 0.0, 75.0 * GRAVITY_M_PER_S2 + noise],
///         moment_nm: [noise, noise, 0.0],
///         ..Zeroable::zeroed()
///     };
///     let suit = SuitSample {
///         sample_time_ns: time_ns,
///         device_counter: cycle as u32,
///         position_m: t_pose_m.map(|[x, y, z]| [x + noise, y, z]),
///         orientation_wxyz: [[1.0, 0.0, 0.0, 0.0]; SEGMENTS],
///         ..Zeroable::zeroed()
///     };
///     let suit = if cycle % 16 == 0 { &[suit][..] } else { &[] };
///     let inputs = Inputs { suit, ground: &[ground], ..Inputs::default() };
///     step(&settings, &mut memory, Tick { cycle, due_ns }, inputs);
/// }
/// assert!((memory.state.mass_kg - 75.0).abs() < 0.1);
/// ```
pub fn step<'m>(settings: &Settings, memory: &'m mut Memory, tick: Tick, inputs: Inputs<'_>) -> &'m State {
    let m = memory;
    let samples = apply_command(settings, m, tick, inputs);
    let streams = ingest_samples(settings, m, tick, &samples);
    let processed = process_instants(settings, m, tick, &streams);
    let planned = plan_poses(settings, m, processed);
    let published = publish_cycle(settings, m, tick, &streams, planned);
    estimate_newest(settings, m, tick, &streams, published);
    &m.state
}

/// [`Inputs`] whose command has been applied.
struct Samples<'a> {
    suit: &'a [SuitSample],
    ground: &'a [GroundSample],
    body: Option<&'a SuitBody>,
}

/// Evidence that all complete instants were processed; the time of the newest, ns.
struct Processed(u64);

/// Evidence that the next pose of the identification was planned; the time of the newest instant, ns.
struct Planned(u64);

/// Evidence that the state of the cycle was published.
struct Published;

/// Applies the command of the cycle.
fn apply_command<'a>(settings: &Settings, m: &mut Memory, tick: Tick, inputs: Inputs<'a>) -> Samples<'a> {
    let Inputs { suit, ground, body, command } = inputs;
    if let Some(command) = command {
        commands::apply(settings, m, command, tick);
    }
    Samples { suit, ground, body }
}

/// Aligns the samples and processes each instant whose window is complete.
fn process_instants(settings: &Settings, m: &mut Memory, tick: Tick, streams: &Streams) -> Processed {
    // Bounded: the queues hold a fixed number of samples.
    while let Some(aligned) = align(settings, &mut m.align, &m.prediction.terms, streams, tick) {
        let snapshot = place(settings, m, &aligned, streams);
        m.history.push(snapshot);
        while let Some(instant) = differentiate(
            settings,
            &mut m.history,
            &m.align,
            &m.placement,
            &m.identification,
            m.reported_body.body(),
        ) {
            process(settings, m, &instant, streams);
        }
    }
    Processed(m.history.released_ns())
}

/// Continues the search for the next pose.
fn plan_poses(settings: &Settings, m: &mut Memory, Processed(instant_ns): Processed) -> Planned {
    m.identification.plan_step(instant_ns, m.publication.stands(), m.reported_body.body(), settings);
    Planned(instant_ns)
}

/// Processes one instant. Each stage has its own state and needs the outputs of the stages before it as arguments, so
/// that another order does not compile: `tests/stage_order.rs` exchanges each two adjacent statements here and in
/// [`step`].
fn process(settings: &Settings, m: &mut Memory, instant: &Instant, streams: &Streams) {
    let ground = measure_ground(settings, &mut m.ground, instant, &m.identification, streams);
    let stillness = detect_static(settings, &mut m.window, instant, &ground, streams);
    let pose_mismatch_rad =
        compare_with_suggestion(settings, &mut m.pose_request, instant, &stillness, &m.identification);
    let prediction = predict_unloaded(
        settings,
        &mut m.prediction,
        instant,
        &ground,
        &stillness,
        &m.identification,
        &m.history,
    );
    let subject = weigh(settings, &mut m.identification, instant, &ground, &prediction);
    let estimate = estimate_cop(settings, instant, &prediction, subject);
    if ground.is_implausible() {
        let agrees = weight_agreement(instant, &ground, &prediction, &estimate, subject);
        m.align.plausibility.ingest_weight_agreement(agrees, instant.step_s);
    }
    let subject = update_from_static_pose(
        settings,
        &mut m.identification,
        &m.window,
        instant,
        &ground,
        &prediction,
        &estimate,
    );
    let overload =
        overload(settings, (&mut m.load, &m.unloaded), instant, &ground, &prediction, &estimate, subject);
    m.ground.ingest_load(overload.as_ref());
    let lag = test_lag(settings, &mut m.lag_test, instant, &ground, &prediction, overload.as_ref(), subject);
    let withheld = validate(instant, &ground, &stillness, overload.as_ref(), lag, subject, streams);
    let outputs = Outputs {
        instant,
        ground: &ground,
        stillness: &stillness,
        prediction: &prediction,
        estimate: &estimate,
        overload: overload.as_ref(),
        withheld: &withheld,
    };
    let exposure = update_exposure(settings, &mut m.exposure, &outputs, subject, m.model_changed_ns);
    m.early.ingest(&outputs, subject);
    let residual = residual(settings, &mut m.unloaded, &outputs, subject);
    m.publication.hold(&outputs, &exposure, pose_mismatch_rad, m.placement.suit_time_ns);
    if let Some(residual) = residual {
        update_models(settings, m, &outputs, &residual);
    }
}

/// Updates error models, registration and identification by the residual of an instant without a load.
fn update_models(settings: &Settings, m: &mut Memory, outputs: &Outputs<'_>, residual: &Residual) {
    let place_is_lost = outputs.instant.place_is_lost;
    if !place_is_lost {
        if outputs.prediction.sigma.may_have_external_force {
            return;
        }
        m.prediction.noise.update_from_residual(outputs, residual);
        m.ground.update_from_residual(settings, outputs.instant, residual);
    }
    let sigma = &m.prediction.noise.sigma();
    let registration = &mut m.placement.registration;
    if let Some(new) = register(settings, registration, outputs, sigma, &m.identification) {
        m.placement.apply(&new);
        m.identification.reset_stance_offset(new.at_m2);
        // Their content uses the previous place, as does the residual.
        m.history.clear();
        m.window.clear();
        m.prediction.terms.restart();
        return;
    }
    if !place_is_lost {
        let input = MotionInput { outputs, residual, sigma, history: &m.history };
        update_from_motion(settings, &mut m.identification, &mut m.motion_updates, &input);
    }
}

/// Ingests the samples of the cycle.
fn ingest_samples(settings: &Settings, m: &mut Memory, tick: Tick, samples: &Samples<'_>) -> Streams {
    if let Some(body) = samples.body {
        m.reported_body.ingest(body, m.align.alignment.newest_suit(), tick.due_ns);
    }
    let (streams, lag) =
        ingest(settings, &mut m.align, &m.prediction.terms, &m.identification, tick, samples);
    m.lag_test.ingest_ground_gap(streams.ground_gap_ns);
    if let LagChange::First { exceeds_window } = lag {
        reset_unaligned(settings, m, exceeds_window);
    }
    streams
}

/// Drops what was computed from force and motion that belonged to different times, before the first lag was known.
fn reset_unaligned(settings: &Settings, m: &mut Memory, exceeds_window: bool) {
    m.prediction.noise = bytemuck::Zeroable::zeroed();
    if m.identification.identified == 1 {
        // The mean force of minutes hardly depends on the lag, and a load may be carried now, which a new weighing would
        // include.
        m.ground.widen_offset();
        return;
    }
    m.identification.reset_weighing();
    if exceeds_window {
        m.reset_to_prior(settings);
        m.motion_updates.used = 0;
    }
}

/// Places an aligned sample on the plate; after a gap, samples from before it are dropped.
fn place(settings: &Settings, m: &mut Memory, aligned: &Aligned, streams: &Streams) -> Snapshot {
    let followed = follow(settings, &mut m.placement, aligned, streams);
    if followed.continuity != Continuity::Continuous {
        m.clear_windows();
        m.identification.follow(followed.continuity, settings);
    }
    let subject = &m.identification;
    let has_results = subject.poses_used > 0 || subject.identified > 0 || m.motion_updates.used > 0;
    let bones = validate_body(&mut m.reported_body, &followed, subject, has_results);
    if matches!(bones, BoneUpdate::Adopt { stays: false } | BoneUpdate::Reset) {
        m.move_stance_offset_to_anchor();
    }
    let suit_body = m.reported_body.body();
    if m.identification.update_bones(bones, suit_body, &followed.in_suit_world, settings) {
        // The change to another body model would otherwise look like a leap of the centre of mass.
        m.history.clear();
    }
    anchor(settings, &mut m.placement, &followed, &m.identification, suit_body)
}

/// Publishes the state of the cycle.
fn publish_cycle(
    settings: &Settings,
    m: &mut Memory,
    tick: Tick,
    streams: &Streams,
    Planned(instant_ns): Planned,
) -> Published {
    let freshness = Freshness::at(settings, &m.align, &m.prediction.terms, streams, instant_ns, tick);
    if let Some(sample) = m.align.alignment.newest_ground().filter(|_| freshness.has_ground_alone()) {
        let alone = measure_ground_alone(settings, &mut m.ground, sample, &m.identification, streams);
        m.publication.hold_ground_alone(&alone);
    }
    let status = Status {
        tick,
        freshness,
        streams,
        skew_s: m.align.skew.published_s(),
        subject: &m.identification,
        reported_body: &m.reported_body,
        suggested: m.pose_request.suggested(settings, &m.identification),
        motion_samples_used: m.motion_updates.used,
        place_is_lost: m.placement.registration.is_lost(),
        model_changed_ns: m.model_changed_ns,
    };
    m.publication.publish(settings, &mut m.state, &status);
    Published
}

/// Estimates about the newest sample, by the published state and the state of all other stages.
fn estimate_newest(settings: &Settings, m: &mut Memory, tick: Tick, streams: &Streams, _: Published) {
    let newest = Newest {
        history: &m.history,
        align: &m.align,
        placement: &m.placement,
        subject: &m.identification,
        suit_body: m.reported_body.body(),
        ground: &m.ground,
        prediction: &m.prediction,
        load: &m.load,
        streams,
        state: &m.state,
        tick,
    };
    estimate_early(settings, &mut m.early, &newest);
}

#[cfg(test)]
mod tests;
