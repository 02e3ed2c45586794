//! Detects that a stream's stamps moved relative to its counter: either the device paused, or its samples arrive later
//! than before, and [`super::clock_fit`] cannot distinguish them.

use bytemuck::{Pod, Zeroable};

use super::clock_fit::{BREAK_LASTS_NS, BREAK_NS};

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

/// The stamps of one stream. All zero before the first sample.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct StampShift {
    session: u64,
    /// First and newest sample whose stamps fit each other; a time of 0 for none.
    first: Stamped,
    newest: Stamped,
    /// A sample that does not fit: an invalid counter, or the first of moved stamps.
    candidate: Stamped,
}

impl StampShift {
    /// Ingests a sample's stamp. Returns whether the stamps have moved: this sample continues the previous one, and both
    /// contradict those before by more than [`BREAK_NS`]. A lost sample has no effect: its count is missing too.
    pub fn ingest(&mut self, session: u32, counter: u32, time_ns: u64) -> bool {
        let sample = Stamped { counter: u64::from(counter), time_ns };
        if self.first.time_ns == 0 || self.session != u64::from(session) {
            *self = StampShift::begin(session, sample, sample);
            return false;
        }
        let (counts, span_ns) = self.newest.since(&self.first);
        // A clock fit of less than this may have such an error itself.
        if counts <= 0.0 || span_ns < BREAK_LASTS_NS {
            self.newest = sample;
            return false;
        }
        let period_ns = span_ns / counts;
        let continues = |earlier: &Stamped| {
            let (counts, span_ns) = sample.since(earlier);
            counts >= 0.0 && (span_ns - counts * period_ns).abs() <= BREAK_NS
        };
        if continues(&self.newest) {
            (self.newest, self.candidate) = (sample, Stamped::default());
            false
        } else if self.candidate.time_ns > 0 && continues(&self.candidate) {
            *self = StampShift::begin(session, self.candidate, sample);
            true
        } else {
            self.candidate = sample;
            false
        }
    }

    fn begin(session: u32, first: Stamped, newest: Stamped) -> StampShift {
        StampShift { session: u64::from(session), first, newest, candidate: Stamped::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 1_000_000_000 / 60;

    /// Ingests ten seconds of samples; `with` changes counter and stamp. Returns the indices at which the stamps moved.
    fn moved_at(with: impl Fn(u32) -> Option<(u32, u64)>) -> [u32; 2] {
        let (mut shift, mut found, mut count) = (StampShift::zeroed(), [0; 2], 0);
        for index in 0..600 {
            let Some((counter, time_ns)) = with(index) else { continue };
            if shift.ingest(0, counter, time_ns) {
                found[count] = index;
                count += 1;
            }
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
        assert_eq!(moved_at(|index| Some((counter(index), stamp_ns(index) + late_ns(index)))), [301, 451]);
    }

    #[test]
    fn losses_odd_counters_jitter_and_a_wrapping_counter_do_not() {
        let lost = |index: u32| index % 7 == 3 || (200..380).contains(&index);
        let jitter_ns = |index: u32| u64::from(index % 3) * 10_000_000;
        let counter = |index: u32| if index == 450 { 7 } else { index.wrapping_sub(500) };
        let with = |index: u32| (!lost(index)).then(|| (counter(index), stamp_ns(index) + jitter_ns(index)));
        assert_eq!(moved_at(with), [0; 2]);
    }

    #[test]
    fn a_new_session_has_no_earlier_stamps() {
        let mut shift = StampShift::zeroed();
        for index in 0..600 {
            let restarted = index >= 300;
            let late_ns = if restarted { 200_000_000 } else { 0 };
            assert!(!shift.ingest(u32::from(restarted), index, stamp_ns(index) + late_ns), "{index}");
        }
    }
}
