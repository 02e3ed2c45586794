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
pub(super) struct Taken {
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
pub(super) struct Waiting<S>(VecDeque<Box<S>>);

impl<S> Default for Waiting<S> {
    fn default() -> Self {
        Waiting(VecDeque::new())
    }
}

impl<S: Counted> Waiting<S> {
    pub(super) fn push(&mut self, sample: Box<S>) {
        self.0.push_back(sample);
    }

    /// Moves the samples that a cycle ingested to `into`; returns whether these are exactly the recorded ones.
    ///
    /// Earlier samples were lost in a full ring before any cycle. Sequence numbers restart with an adapter, so the time
    /// is compared too.
    pub(super) fn take(&mut self, taken: Taken, into: &mut Vec<S>) -> bool {
        into.clear();
        let count = taken.count as usize;
        if count == 0 {
            return true;
        }
        let is_first = |at: usize| {
            let last = at.checked_add(count - 1).and_then(|last| self.0.get(last));
            self.0[at].sequence() == taken.first
                && last.is_some_and(|last| {
                    last.sequence() == taken.last && last.sample_time_ns() == taken.last_sample_time_ns
                })
        };
        let Some(at) = (0..self.0.len()).find(|at| is_first(*at)) else { return false };
        into.extend(self.0.drain(..at + count).skip(at).map(|sample| *sample));
        true
    }

    /// Drops samples published before a time.
    pub(super) fn give_up_before(&mut self, time_ns: u64) {
        while self.0.pop_front_if(|sample| sample.published_ns() < time_ns).is_some() {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn of(numbers: &[u64]) -> Waiting<GroundSample> {
        let mut waiting = Waiting::default();
        for (time_ns, &sequence) in numbers.iter().enumerate() {
            let sample_time_ns = time_ns as u64;
            waiting.push(Box::new(GroundSample { sequence, sample_time_ns, ..GroundSample::zeroed() }));
        }
        waiting
    }

    fn take(waiting: &mut Waiting<GroundSample>, first: u64, last: u64, count: u32, at: u64) -> Option<u64> {
        let mut into = Vec::new();
        let taken = Taken { first, last, count, last_sample_time_ns: at };
        waiting.take(taken, &mut into).then_some(into.iter().map(|sample| sample.sequence).sum())
    }

    #[test]
    fn a_cycle_gets_its_samples_and_what_a_ring_lost_before_them_is_dropped() {
        let mut waiting = of(&[3, 4, 5, 6, 7]);
        assert_eq!(take(&mut waiting, 0, 0, 0, 0), Some(0));
        assert_eq!(take(&mut waiting, 5, 6, 2, 3), Some(11));
        assert_eq!(take(&mut waiting, 4, 4, 1, 1), None);
        assert_eq!(take(&mut waiting, 7, 7, 1, 4), Some(7));
    }

    #[test]
    fn what_is_not_there_is_not_taken_in_part() {
        let mut waiting = of(&[3, 4, 6]);
        assert_eq!(take(&mut waiting, 3, 6, 4, 3), None);
        assert_eq!(take(&mut waiting, 3, 6, u32::MAX, 3), None);
        assert_eq!(take(&mut waiting, 3, 4, 2, 1), Some(7));
    }

    #[test]
    fn a_restarted_adapter_counts_from_zero() {
        let mut waiting = of(&[8, 9, 1, 2, 8, 9]);
        assert_eq!(take(&mut waiting, 9, 1, 2, 2), Some(10));
        assert_eq!(take(&mut waiting, 8, 9, 2, 5), Some(17));
    }
}
