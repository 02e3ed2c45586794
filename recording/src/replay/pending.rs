//! Samples of one stream, buffered until a cycle record states that the cycle ingested them.

use std::collections::VecDeque;

use equipoise_core::message::{GroundSample, SuitSample};

/// Properties that identify a sample of a stream.
pub(super) trait Counted: Copy {
    /// The adapter's sequence number.
    fn sequence(&self) -> u64;
    /// Sample time, CLOCK_MONOTONIC ns.
    fn sample_time_ns(&self) -> u64;
    /// Time of publication, CLOCK_MONOTONIC ns.
    fn published_ns(&self) -> u64;
}

impl Counted for SuitSample {
    fn sequence(&self) -> u64 {
        self.sequence
    }
    fn sample_time_ns(&self) -> u64 {
        self.sample_time_ns
    }
    fn published_ns(&self) -> u64 {
        self.published_ns
    }
}

impl Counted for GroundSample {
    fn sequence(&self) -> u64 {
        self.sequence
    }
    fn sample_time_ns(&self) -> u64 {
        self.sample_time_ns
    }
    fn published_ns(&self) -> u64 {
        self.published_ns
    }
}

/// Samples of one stream that a cycle ingested, according to its record.
#[derive(Debug, Clone, Copy)]
pub(super) struct IngestedSamples {
    /// Sequence number of the first sample.
    pub(super) first: u64,
    /// Sequence number of the last sample.
    pub(super) last: u64,
    /// Number of samples.
    pub(super) count: u32,
    /// Sample time of the last sample.
    pub(super) last_sample_time_ns: u64,
}

/// The stream's samples in the order of publication.
pub(super) struct Pending<S>(VecDeque<Box<S>>);

impl<S> Default for Pending<S> {
    fn default() -> Self {
        Pending(VecDeque::new())
    }
}

impl<S: Counted> Pending<S> {
    pub(super) fn push(&mut self, sample: Box<S>) {
        self.0.push_back(sample);
    }

    /// Moves the samples that a cycle ingested to `into`; returns whether these are exactly the recorded ones.
    ///
    /// Earlier samples were lost in a full ring before any cycle. Sequence numbers restart with an adapter, so the time
    /// is compared too.
    pub(super) fn pop(&mut self, ingested: IngestedSamples, into: &mut Vec<S>) -> bool {
        into.clear();
        let count = ingested.count as usize;
        if count == 0 {
            return true;
        }
        let is_first = |at: usize| {
            let last = at.checked_add(count - 1).and_then(|last| self.0.get(last));
            self.0[at].sequence() == ingested.first
                && last.is_some_and(|last| {
                    last.sequence() == ingested.last && last.sample_time_ns() == ingested.last_sample_time_ns
                })
        };
        let Some(at) = (0..self.0.len()).find(|at| is_first(*at)) else { return false };
        into.extend(self.0.drain(..at + count).skip(at).map(|sample| *sample));
        true
    }

    /// Drops samples published before a time.
    pub(super) fn discard_before(&mut self, time_ns: u64) {
        while self.0.pop_front_if(|sample| sample.published_ns() < time_ns).is_some() {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn of(numbers: &[u64]) -> Pending<GroundSample> {
        let mut pending = Pending::default();
        for (time_ns, &sequence) in numbers.iter().enumerate() {
            let sample_time_ns = time_ns as u64;
            pending.push(Box::new(GroundSample { sequence, sample_time_ns, ..GroundSample::zeroed() }));
        }
        pending
    }

    fn take(pending: &mut Pending<GroundSample>, first: u64, last: u64, count: u32, at: u64) -> Option<u64> {
        let mut into = Vec::new();
        let ingested = IngestedSamples { first, last, count, last_sample_time_ns: at };
        pending.pop(ingested, &mut into).then_some(into.iter().map(|sample| sample.sequence).sum())
    }

    #[test]
    fn a_cycle_receives_its_samples_and_earlier_ones_are_dropped() {
        let mut pending = of(&[3, 4, 5, 6, 7]);
        assert_eq!(take(&mut pending, 0, 0, 0, 0), Some(0));
        assert_eq!(take(&mut pending, 5, 6, 2, 3), Some(11));
        assert_eq!(take(&mut pending, 4, 4, 1, 1), None);
        assert_eq!(take(&mut pending, 7, 7, 1, 4), Some(7));
    }

    #[test]
    fn incomplete_samples_are_not_popped() {
        let mut pending = of(&[3, 4, 6]);
        assert_eq!(take(&mut pending, 3, 6, 4, 3), None);
        assert_eq!(take(&mut pending, 3, 6, u32::MAX, 3), None);
        assert_eq!(take(&mut pending, 3, 4, 2, 1), Some(7));
    }

    #[test]
    fn a_restarted_adapter_counts_from_zero() {
        let mut pending = of(&[8, 9, 1, 2, 8, 9]);
        assert_eq!(take(&mut pending, 9, 1, 2, 2), Some(10));
        assert_eq!(take(&mut pending, 8, 9, 2, 5), Some(17));
    }
}
