//! Compares the suit's stamps with its counter.
//!
//! [`crate::time::clock_fit`] moves its line if samples arrive earlier or, for a second, later than before. Then either
//! the device paused or the delay changed, which the fit cannot distinguish. The interval between the stamps on both
//! sides of the move is wrong, which would appear as acceleration.

use bytemuck::{Pod, Zeroable};

use crate::message::SuitSample;
use crate::time::clock_fit::{BREAK_LASTS_NS, BREAK_NS};

/// Larger deviations of an interval between two samples make it uncertain, ns: half a sample of the fastest suit.
const UNEVEN_NS: f64 = 2e6;
/// Number of samples over which the time per count is averaged: a clock fit's noise of 0.1 ms then adds 1 ms to a gap of
/// ten seconds at 240 Hz.
const PERIOD_OVER: f64 = 256.0;

/// The stamp of a sample relative to the previous ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stamp {
    /// As expected by the counter. Lost samples have no effect: their counts are missing too.
    Even,
    /// Earlier or later: the time since the previous sample is unknown.
    Uneven,
    /// This sample continues the previous one, and both contradict those before by more than [`BREAK_NS`].
    Moved,
}

/// Counter and stamp of a sample.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
struct Stamped {
    counter: u64,
    time_ns: u64,
}

impl Stamped {
    /// Counts and time since an earlier sample, ns. The counter wraps.
    fn since(&self, earlier: &Stamped) -> (f64, f64) {
        let counts = (self.counter as u32).wrapping_sub(earlier.counter as u32).cast_signed();
        (f64::from(counts), self.time_ns.wrapping_sub(earlier.time_ns).cast_signed() as f64)
    }
}

/// The stamps of a session. All zero before the first sample.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct StampMonitor {
    session: u64,
    /// Time of the first sample, ns; 0 for none.
    first_ns: u64,
    /// The newest sample that continues the previous ones.
    newest: Stamped,
    /// Time per count, ns.
    period_ns: f64,
    /// Number of intervals in it.
    intervals: f64,
    /// The last sample if it does not continue them: an invalid counter, the first of moved stamps, or of another
    /// rate; a time of 0 for none.
    candidate: Stamped,
    /// Time per count before the candidate, ns; two equal ones are another rate.
    interval_ns: f64,
}

impl StampMonitor {
    /// Ingests a sample.
    pub(super) fn ingest(&mut self, suit: &SuitSample) -> Stamp {
        let sample = Stamped { counter: u64::from(suit.device_counter), time_ns: suit.sample_time_ns };
        if self.first_ns == 0 || self.session != u64::from(suit.session) {
            *self = StampMonitor {
                session: u64::from(suit.session),
                first_ns: sample.time_ns,
                newest: sample,
                ..Zeroable::zeroed()
            };
            return Stamp::Even;
        }
        let (counts, span_ns) = sample.since(&self.newest);
        let age_ns = self.newest.time_ns.saturating_sub(self.first_ns) as f64;
        // A younger clock fit may have such an error itself, and some sources do not count.
        if age_ns < BREAK_LASTS_NS || self.intervals == 0.0 {
            self.newest = sample;
            self.average(counts, span_ns);
            return Stamp::Even;
        }
        let off_ns = |earlier: &Stamped| match sample.since(earlier) {
            (counts @ 0.0.., span_ns) => (span_ns - counts * self.period_ns).abs(),
            _ => f64::INFINITY,
        };
        if off_ns(&self.newest) <= UNEVEN_NS {
            self.accept(sample);
            self.average(counts, span_ns);
            return Stamp::Even;
        }
        if self.candidate.time_ns > 0 && off_ns(&self.candidate) <= UNEVEN_NS {
            let has_moved = off_ns(&self.newest) > BREAK_NS;
            self.accept(sample);
            return if has_moved { Stamp::Moved } else { Stamp::Even };
        }
        let (before_ns, had_candidate) = (self.interval_ns, self.candidate.time_ns > 0);
        let (counts, span_ns) = sample.since(&self.candidate);
        self.candidate = sample;
        self.interval_ns = if had_candidate && counts > 0.0 { span_ns / counts } else { 0.0 };
        let is_steady = (self.interval_ns - before_ns).abs() <= UNEVEN_NS && self.interval_ns > UNEVEN_NS;
        if is_steady {
            self.accept(sample);
            self.intervals = 0.0;
            self.average(counts, span_ns);
        }
        Stamp::Uneven
    }

    /// Continues with a sample.
    fn accept(&mut self, sample: Stamped) {
        (self.newest, self.candidate, self.interval_ns) = (sample, Stamped::default(), 0.0);
    }

    fn average(&mut self, counts: f64, span_ns: f64) {
        if counts > 0.0 && span_ns > 0.0 {
            self.intervals = (self.intervals + 1.0).min(PERIOD_OVER);
            self.period_ns += (span_ns / counts - self.period_ns) / self.intervals;
        }
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        self.period_ns >= 0.0
            && self.period_ns.is_finite()
            && (0.0..=PERIOD_OVER).contains(&self.intervals)
            && self.interval_ns.abs() < 1e18
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 1_000_000_000 / 60;

    /// Ingests ten seconds of samples; `with` changes counter and stamp. Returns the first two indices with that result.
    fn found(what: Stamp, with: impl Fn(u32) -> Option<(u32, u64)>) -> [u32; 2] {
        let (mut monitor, mut found, mut count) = (StampMonitor::zeroed(), [0; 2], 0);
        for index in 0..600 {
            let Some((device_counter, sample_time_ns)) = with(index) else { continue };
            let sample = SuitSample { device_counter, sample_time_ns, ..Zeroable::zeroed() };
            if monitor.ingest(&sample) == what && count < 2 {
                found[count] = index;
                count += 1;
            }
            assert!(monitor.is_sound());
        }
        found
    }

    fn stamp_ns(index: u32) -> u64 {
        5_000_000_000 + u64::from(index) * PERIOD_NS
    }

    #[test]
    fn a_delay_and_its_end_move_the_stamps_at_the_second_sample() {
        let late_ns = |index: u32| if (300..450).contains(&index) { 60_000_000 } else { 0 };
        let counter = |index: u32| index.wrapping_sub(320);
        let late = |index: u32| Some((counter(index), stamp_ns(index) + late_ns(index)));
        assert_eq!(found(Stamp::Moved, late), [301, 451]);
        assert_eq!(found(Stamp::Uneven, late), [300, 450]);
    }

    #[test]
    fn losses_jitter_and_a_wrapping_counter_are_even() {
        let lost = |index: u32| index % 7 == 3 || (200..380).contains(&index);
        let jitter_ns = |index: u32| u64::from(index % 3) * 500_000;
        let with = |index: u32| {
            (!lost(index)).then(|| (index.wrapping_sub(500), stamp_ns(index) + jitter_ns(index)))
        };
        assert_eq!([Stamp::Uneven, Stamp::Moved].map(|what| found(what, with)), [[0; 2]; 2]);
    }

    #[test]
    fn one_invalid_counter_and_one_early_sample_are_uneven_and_move_nothing() {
        let counter = |index: u32| if index == 450 { 7 } else { index };
        let early_ns = |index: u32| if index >= 300 { 10_000_000 } else { 0 };
        let with = |index: u32| Some((counter(index), stamp_ns(index) - early_ns(index)));
        assert_eq!(found(Stamp::Uneven, with), [300, 450]);
        assert_eq!(found(Stamp::Moved, with), [0; 2]);
    }

    #[test]
    fn a_delay_that_ends_with_samples_of_one_instant_moves_the_stamps() {
        // Of twenty samples that arrive at once, the stamps differ by a nanosecond.
        let ends = |index: u32| match index {
            ..300 => stamp_ns(index) + 20 * PERIOD_NS,
            300..320 => stamp_ns(319) + u64::from(index - 299),
            _ => stamp_ns(index),
        };
        assert_eq!(found(Stamp::Moved, |index| Some((index, ends(index))))[0], 320);
    }

    #[test]
    fn another_rate_is_uneven_for_two_samples() {
        let stamp = |index: u32| stamp_ns(index.min(300)) + u64::from(index.saturating_sub(300)) * 25_000_000;
        let last = (301..600).rev().find(|last| {
            let mut monitor = StampMonitor::zeroed();
            (0..=*last).fold(Stamp::Even, |_, index| {
                let sample =
                    SuitSample { device_counter: index, sample_time_ns: stamp(index), ..Zeroable::zeroed() };
                monitor.ingest(&sample)
            }) != Stamp::Even
        });
        assert!(last.is_some_and(|last| (301..305).contains(&last)), "{last:?}");
    }

    #[test]
    fn a_new_session_has_no_earlier_stamps() {
        let mut monitor = StampMonitor::zeroed();
        for index in 0..600 {
            let restarted = index >= 300;
            let late_ns = if restarted { 200_000_000 } else { 0 };
            let sample = SuitSample {
                session: u32::from(restarted),
                device_counter: index,
                sample_time_ns: stamp_ns(index) + late_ns,
                ..Zeroable::zeroed()
            };
            assert_eq!(monitor.ingest(&sample), Stamp::Even, "{index}");
        }
    }
}
