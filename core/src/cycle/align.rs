//! Stage `align`: validates samples on arrival, estimates the skew between the streams, and pairs suit samples with the
//! wrench at their time.

use bytemuck::{Pod, Zeroable};

use super::alignment::{Aligned, Alignment, WAIT_MAX_NS};
use super::identification::Identification;
use super::memory::EMPTY_PLATE_N;
use super::model_terms::ModelTerms;
use super::plausibility::{Bones, Plausibility};
use super::settings::Settings;
use super::skew_monitor::{LagChange, SkewMonitor};
use super::streams::Streams;
use super::tare::Tare;
use super::{Samples, Tick};
use crate::effect::without_lag_ns;
use crate::message::SuitSample;

/// State of the stage.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct AlignState {
    /// Queues that pair the samples of both streams.
    pub(super) alignment: Alignment,
    /// Plausibility checks of samples before alignment.
    pub(super) plausibility: Plausibility,
    /// Skew between the streams, and the lag used to correct it.
    pub(super) skew: SkewMonitor,
    /// Readings of the empty plate.
    pub(super) tare: Tare,
}

impl AlignState {
    /// Tares the plate with its present readings. Returns the change of the vertical force's zero, N; `None` if a person
    /// stands on the plate or it reports a fault.
    pub(super) fn tare(&mut self) -> Option<f64> {
        let tare = self.alignment.tare(EMPTY_PLATE_N)?;
        self.tare.add(&tare);
        self.plausibility.change_zero();
        Some(tare.force_n[2])
    }

    /// Replaces the suit's lag by the model, s. Samples that wait for the ground still have the previous stamps.
    pub(super) fn replace_model_lag(&mut self, lag_s: f64) {
        if self.skew.replace_model_lag(lag_s) {
            self.alignment.drop_waiting();
        }
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.alignment.is_sound()
            && self.plausibility.is_sound()
            && self.skew.is_sound()
            && self.tare.is_sound()
    }
}

/// Ingests the samples of a cycle.
pub(super) fn ingest(
    settings: &Settings,
    state: &mut AlignState,
    terms: &ModelTerms,
    subject: &Identification,
    tick: Tick,
    samples: &Samples<'_>,
) -> (Streams, LagChange) {
    let AlignState { alignment, plausibility, skew, tare } = state;
    let mut ground_gap_ns = 0;
    for sample in samples.ground {
        // Subtract the tare first: it may contain components that this device does not measure.
        let sample = tare.subtract_from(sample).mask_unmeasured();
        if alignment.admits_ground(&sample, tick.due_ns) {
            if let Some(newest) = alignment.newest_ground() {
                ground_gap_ns =
                    ground_gap_ns.max(sample.sample_time_ns.saturating_sub(newest.sample_time_ns));
                skew.compare_epochs([newest, &sample].map(|sample| (sample.sequence, sample.clock_epoch)));
            }
            if plausibility.check_ground(&sample, alignment.newest_ground()) {
                skew.ingest_ground(&sample);
            }
            alignment.push_ground(&sample);
        }
    }
    let mut lag_change = LagChange::None;
    for sample in samples.suit {
        let model_lag_s = terms.suit_lag_s(&settings.model, sample.sample_time_ns);
        let sample_time_ns = without_lag_ns(sample.sample_time_ns, model_lag_s);
        let sample = SuitSample { sample_time_ns, ..*sample };
        if !alignment.admits_suit(&sample, tick.due_ns) {
            continue;
        }
        if let Some(newest) = alignment.newest_suit() {
            skew.compare_epochs([newest, &sample].map(|sample| (sample.sequence, sample.clock_epoch)));
        }
        let bones = Bones::of(subject, settings);
        if !plausibility.check_suit(&sample, alignment.newest_suit(), &bones) {
            continue;
        }
        alignment.push_suit(&sample);
        if subject.has_body() {
            let change = skew.update(settings, &sample, subject.anthropometry(), model_lag_s);
            if change != LagChange::None {
                lag_change = change;
            }
            alignment.set_lag_ns(skew.lag_ns());
        }
    }
    let streams = Streams {
        suit_period_ns: alignment.suit_period_ns(),
        ground_period_ns: alignment.ground_period_ns(),
        lag_sigma_s: skew.lag_sigma_s(),
        lag_is_off: skew.is_off(),
        suit_suspect: plausibility.suit,
        ground_suspect: plausibility.ground,
        ground_gap_ns,
        ground_resumed_ns: plausibility.resumed_ns,
        ground_late_ns: alignment.ground_late_ns(),
        moved_ns: plausibility.moved_ns,
    };
    (streams, lag_change)
}

/// The next suit sample whose wrench is available, or that has waited long enough.
pub(super) fn align(
    settings: &Settings,
    state: &mut AlignState,
    terms: &ModelTerms,
    streams: &Streams,
    tick: Tick,
) -> Option<Aligned> {
    state.alignment.next(tick.due_ns, wait_max_ns(settings, terms, streams, tick))
}

/// Expected age of a suit sample on arrival, ns: latency of the adapter and lag of the model.
pub(super) fn suit_latency_ns(settings: &Settings, terms: &ModelTerms, tick: Tick) -> u64 {
    let lag_s = terms.suit_lag_s(&settings.model, tick.due_ns);
    settings.suit_latency_ns + (lag_s.max(0.0) * 1e9) as u64
}

/// Age after which a suit sample is processed without a ground sample, ns.
///
/// Includes the constant latencies of both streams, which delay samples but are no silence.
pub(super) fn wait_max_ns(settings: &Settings, terms: &ModelTerms, streams: &Streams, tick: Tick) -> u64 {
    let latency_ns = suit_latency_ns(settings, terms, tick).max(settings.ground_latency_ns);
    WAIT_MAX_NS + latency_ns + streams.ground_late_ns
}
