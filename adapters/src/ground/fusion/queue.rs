//! Queue of the second device's recent samples, with interpolation at a given time.

use std::collections::VecDeque;

use equipoise_core::message::GroundSample;

/// Neighbours farther apart are not interpolated, ns; the same limit as in the loop's own alignment.
const GAP_MAX_NS: u64 = 60_000_000;
/// Capacity: more than a second of the fastest device.
const KEPT_MAX: usize = 20_000;

/// Samples of the second device, ordered by time.
#[derive(Debug, Default)]
pub(super) struct Partners {
    samples: VecDeque<GroundSample>,
    last_arrival_ns: Option<u64>,
}

/// Result for the second device at a given time.
#[derive(Debug, Clone, Copy)]
pub(super) enum PartnerLookup {
    /// The interpolated sample.
    Partner(GroundSample),
    /// Not available yet.
    NotYet,
    /// Never available: a gap, or before the first sample.
    Nothing,
}

impl Partners {
    /// Adds a sample; `false` if its time does not advance. A restarted device may begin at an earlier time.
    pub(super) fn push(&mut self, sample: GroundSample, now_ns: u64) -> bool {
        if let Some(newest) = self.samples.back()
            && sample.sample_time_ns <= newest.sample_time_ns
        {
            if sample.session == newest.session {
                return false;
            }
            self.samples.clear();
        }
        if self.samples.len() == KEPT_MAX {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
        self.last_arrival_ns = Some(now_ns);
        true
    }

    /// Arrival of the newest sample, ns; `None` before the first.
    pub(super) fn last_arrival_ns(&self) -> Option<u64> {
        self.last_arrival_ns
    }

    /// The sample at a time. Requested times must not decrease: older samples are discarded.
    pub(super) fn at(&mut self, time_ns: u64) -> PartnerLookup {
        while self.samples.get(1).is_some_and(|next| next.sample_time_ns <= time_ns) {
            self.samples.pop_front();
        }
        let Some(earlier) = self.samples.front() else { return PartnerLookup::NotYet };
        let after_ns = match time_ns.checked_sub(earlier.sample_time_ns) {
            None => return PartnerLookup::Nothing,
            Some(0) => return PartnerLookup::Partner(*earlier),
            Some(after_ns) => after_ns,
        };
        let Some(later) = self.samples.get(1) else { return PartnerLookup::NotYet };
        let span_ns = later.sample_time_ns - earlier.sample_time_ns;
        if span_ns > GAP_MAX_NS {
            return PartnerLookup::Nothing;
        }
        PartnerLookup::Partner(earlier.between(later, after_ns as f64 / span_ns as f64))
    }
}
