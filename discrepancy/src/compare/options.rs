//! Options of the reduction of snapshots to blocks.

use crate::block::Phase;
use crate::constants::{BLOCK_S, BLOCKS_MAX, HALF_WINDOW_S, LAGS_S, SNAPSHOT_GAP_S, STANCE_MARGIN_S};
use crate::session::Spans;

/// Options of the reduction of snapshots to blocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Start of the recording, CLOCK_MONOTONIC ns.
    pub begin_ns: u64,
    /// Phases of the recording.
    pub spans_s: Spans,
    /// Length of a block, s.
    pub block_s: f64,
    /// Half the window of the local parabola, s.
    pub half_window_s: f64,
    /// Nothing is compared within this time of a foot's lift-off or contact, s.
    pub stance_margin_s: f64,
    /// Snapshots farther apart than this are a gap, s.
    pub gap_max_s: f64,
    /// Whether the model includes the body's inertia.
    pub has_inertia: bool,
    /// Maximum number of stored blocks; of a longer recording every second, fourth, … block of a phase.
    pub blocks_max: usize,
}

impl Options {
    /// The default.
    pub fn new(begin_ns: u64, spans_s: Spans, has_inertia: bool) -> Options {
        Options {
            begin_ns,
            spans_s,
            block_s: BLOCK_S,
            half_window_s: HALF_WINDOW_S,
            stance_margin_s: STANCE_MARGIN_S,
            gap_max_s: SNAPSHOT_GAP_S,
            has_inertia,
            blocks_max: BLOCKS_MAX,
        }
    }

    /// Time of a stamp since the recording's start, s; negative before it.
    pub(super) fn seconds(&self, time_ns: u64) -> f64 {
        (i128::from(time_ns) - i128::from(self.begin_ns)) as f64 * 1e-9
    }

    /// Time after which all data around a block are available, s.
    pub(super) fn delay_s(&self) -> f64 {
        let latest_lag_s = LAGS_S[LAGS_S.len() - 1];
        // A point is complete half a window and at most a gap after its time.
        let predicted_s = latest_lag_s + self.half_window_s + self.gap_max_s;
        self.stance_margin_s.max(predicted_s)
    }

    /// The phase that contains the whole interval.
    pub(super) fn phase_of(&self, [from_s, to_s]: [f64; 2]) -> Option<Phase> {
        let lies_in = |span_s: [f64; 2]| span_s[0] <= from_s && to_s <= span_s[1];
        let spans = &self.spans_s;
        if lies_in(spans.identify) {
            Some(Phase::Identify)
        } else if spans.reference.is_some_and(lies_in) {
            Some(Phase::Reference)
        } else {
            lies_in(spans.work).then_some(Phase::Work)
        }
    }
}
