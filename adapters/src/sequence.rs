//! Orders samples by a wrapping counter: classifies a sample as next, old or first of a restarted counter.

const NS_PER_S: u64 = 1_000_000_000;
/// Count of consecutive samples that must advance, each within [`RESTART_WITHIN_NS`], before a jump is accepted.
const RESTART_CONFIRMATIONS: u32 = 2;
const RESTART_WITHIN_NS: u64 = NS_PER_S / 4;
/// A step back of at most this many counts is a reordered datagram, not a new session; for counters with one count for
/// each datagram.
const REORDER_WINDOW: u32 = 8;
/// A leap of at most this many counts is a gap, however short the time.
const PLAUSIBLE_LEAP: u64 = 1000;

/// Position of a sample relative to the newest one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SequencePosition {
    /// The first sample of the stream.
    First,
    /// Later than the newest one by `gap` counts.
    Next {
        /// At least 1. A gap above the device's stride means loss.
        gap: u32,
    },
    /// The newest one repeated.
    Same,
    /// Before the newest one, or a jump that is not yet accepted.
    Old,
    /// The counter has restarted and this is its first accepted sample.
    NewSession,
}

/// The newest counter of a stream, and the candidate of a new session.
///
/// A gap alone never starts a new session; neither does a single datagram with an arbitrary counter.
#[derive(Debug, Clone)]
pub struct Sequence {
    max_rate_hz: u64,
    overtaken_max: u32,
    newest: Option<CounterSample>,
    suspect: Option<(CounterSample, u32)>,
}

#[derive(Debug, Clone, Copy)]
struct CounterSample {
    counter: u32,
    arrival_ns: u64,
}

impl CounterSample {
    /// Counts from `self` to `counter`, negative backwards, over the wrap.
    fn steps_to(self, counter: u32) -> i32 {
        counter.wrapping_sub(self.counter).cast_signed()
    }
}

impl Sequence {
    /// For a device whose counter runs at `max_rate_hz` at most; a faster leap is not accepted.
    pub fn new(max_rate_hz: u64) -> Self {
        Sequence { max_rate_hz, overtaken_max: REORDER_WINDOW, newest: None, suspect: None }
    }

    /// For counters that advance by many counts with each datagram: a datagram that is behind by at most this was
    /// overtaken.
    pub fn overtaken_by_at_most(self, counts: u32) -> Self {
        Sequence { overtaken_max: counts, ..self }
    }

    /// The next sample is the first, as the stream was restarted on request.
    pub fn reset(&mut self) {
        self.newest = None;
        self.suspect = None;
    }

    /// Processes a sample and returns its position.
    pub fn classify(&mut self, counter: u32, arrival_ns: u64) -> SequencePosition {
        let sample = CounterSample { counter, arrival_ns };
        let Some(newest) = self.newest else {
            self.newest = Some(sample);
            return SequencePosition::First;
        };
        let steps = newest.steps_to(counter);
        if steps == 0 {
            return SequencePosition::Same;
        }
        let elapsed_ns = arrival_ns.saturating_sub(newest.arrival_ns);
        let plausible =
            PLAUSIBLE_LEAP.saturating_add((elapsed_ns / 1000).saturating_mul(self.max_rate_hz) / 1_000_000);
        if steps > 0 && u64::from(steps.unsigned_abs()) <= plausible {
            self.newest = Some(sample);
            self.suspect = None;
            return SequencePosition::Next { gap: steps.unsigned_abs() };
        }
        if steps < 0 && steps.unsigned_abs() <= self.overtaken_max {
            return SequencePosition::Old;
        }
        self.check_restart(sample)
    }

    /// A jump: accepted once the counter continues from it.
    fn check_restart(&mut self, sample: CounterSample) -> SequencePosition {
        let confirmations = match self.suspect {
            Some((before, _)) if before.steps_to(sample.counter) == 0 => return SequencePosition::Old,
            Some((before, confirmations)) => {
                let forward = before.steps_to(sample.counter) > 0
                    && u64::from(before.steps_to(sample.counter).unsigned_abs()) <= PLAUSIBLE_LEAP;
                let soon = sample.arrival_ns.saturating_sub(before.arrival_ns) <= RESTART_WITHIN_NS;
                if forward && soon { confirmations + 1 } else { 0 }
            }
            None => 0,
        };
        if confirmations < RESTART_CONFIRMATIONS {
            self.suspect = Some((sample, confirmations));
            return SequencePosition::Old;
        }
        self.newest = Some(sample);
        self.suspect = None;
        SequencePosition::NewSession
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use SequencePosition::{First, NewSession, Next, Old, Same};

    const NS_PER_MS: u64 = 1_000_000;

    fn classified(stream: &[(u32, u64)]) -> Vec<SequencePosition> {
        let mut sequence = Sequence::new(1000);
        stream.iter().map(|(counter, ms)| sequence.classify(*counter, ms * NS_PER_MS)).collect()
    }

    #[test]
    fn forward_same_and_overtaken() {
        let got = classified(&[(10, 0), (11, 4), (11, 5), (14, 16), (12, 17), (13, 18), (15, 20)]);
        assert_eq!(got, [First, Next { gap: 1 }, Same, Next { gap: 3 }, Old, Old, Next { gap: 1 }]);
    }

    #[test]
    fn the_counter_wraps() {
        assert_eq!(classified(&[(u32::MAX, 0), (1, 8)]), [First, Next { gap: 2 }]);
    }

    #[test]
    fn a_gap_is_no_new_session() {
        assert_eq!(classified(&[(10, 0), (20_000, 60_000)]), [First, Next { gap: 19_990 }]);
    }

    #[test]
    fn a_restart_is_accepted_at_the_second_step_forward() {
        assert_eq!(
            classified(&[(5000, 0), (0, 4), (0, 5), (1, 8), (2, 12), (3, 16)]),
            [First, Old, Old, Old, NewSession, Next { gap: 1 }]
        );
        // Too slow, or interrupted by the stream that continues: not accepted.
        assert_eq!(classified(&[(5000, 0), (0, 4), (1, 300), (2, 600)]), [First, Old, Old, Old]);
        let got = classified(&[(5000, 0), (0, 1), (5001, 4), (1, 5), (5002, 8), (2, 9), (5003, 12)]);
        assert!(!got.contains(&NewSession), "{got:?}");
    }

    #[test]
    fn a_single_wrong_counter_is_rejected() {
        let got = classified(&[(10, 0), (2_000_000_000, 4), (11, 5), (12, 8)]);
        assert_eq!(got, [First, Old, Next { gap: 1 }, Next { gap: 1 }]);
    }
}
