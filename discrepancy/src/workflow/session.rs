//! Compares the frozen subject model with the plate over the whole time of the subject.

use anyhow::bail;
use equipoise_core::cycle::{Inputs, Motion, Tick, step};
use equipoise_recording::replay::samples::SkippedData;
use equipoise_recording::replay::synthetic_ticks;

use crate::compare::{Comparison, Options, Worker, prior_covariance_m2};
use crate::session::Session;
use crate::spans::ResolvedSpans;

use super::identify::Identified;
use super::survey::Survey;
use super::{Progress, Reconcile, cutoff};
use crate::constants::TICK_NS;

/// Runs the frozen subject model over the subject's part of the recording.
pub(super) fn compare(
    reconcile: &Reconcile<'_>,
    survey: &Survey,
    identified: &Identified,
    spans: &ResolvedSpans,
    progress: &mut dyn FnMut(Progress),
) -> anyhow::Result<(Session, SkippedData)> {
    let settings = reconcile.settings();
    let Some(worker) = Worker::of(&identified.worker, &settings) else {
        bail!("the worker's mass is unavailable: no static pose on the plate; set subject.mass_kg");
    };
    let has_inertia = settings.motion != Motion::Paper;
    let mut options = Options::new(survey.begin_ns(), spans.spans_s, has_inertia);
    // A configuration for slowly sampled data requests a longer window.
    options.half_window_s = options.half_window_s.max(settings.half_window_ns() as f64 * 1e-9);
    let mut comparison = Comparison::new(worker, options);
    let mut memory = survey.recorded.initial_memory(&settings);
    memory.identification = *identified.worker;
    let mut samples = reconcile.input.samples(reconcile.config)?;
    let length_s = survey.samples_s()[1];
    let (mut pushed_ns, mut held_ns) = (0, 0);
    let of_subject = samples.by_ref().filter(|sample| survey.covers(sample.time_ns()));
    synthetic_ticks::run(
        of_subject,
        TICK_NS,
        &survey.recorded.tares_ns,
        |tick: Tick, inputs: Inputs<'_>| {
            let fraction = survey.seconds(tick.due_ns) / length_s.max(1e-9);
            progress(Progress { doing: "comparing model and plate", fraction });
            let state = *step(&settings, &mut memory, tick, inputs);
            if state.suit_sample_time_ns != held_ns {
                held_ns = state.suit_sample_time_ns;
                comparison.hold(held_ns, state.static_pose == 1);
            }
            for moment in memory.history.since(pushed_ns) {
                pushed_ns = moment.time_ns;
                comparison.push(moment);
            }
            Ok(())
        },
    )?;
    let has_shear = comparison.has_shear();
    let (blocks, left_out) = comparison.finish();
    let mut session = Session {
        mass_kg: worker.mass_kg,
        prior_covariance_m2: prior_covariance_m2(&identified.worker, &settings),
        has_shear,
        has_inertia,
        suit_drifts: settings.suit_drifts,
        block_s: options.block_s,
        spans_s: spans.spans_s,
        length_s,
        blocks,
        left_out,
    };
    cutoff::subtract(&mut session.blocks, &settings.model);
    Ok((session, samples.skipped()))
}
