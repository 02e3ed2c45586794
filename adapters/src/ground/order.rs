//! Sequence numbers and times of any width and unit, converted to what the receiver takes; for devices with a
//! configured layout.

use super::lead::Lead;
use super::reading::{Decoded, Tick};
use super::refusal::GroundRefusal;
use crate::sequence::{Sequence, SequencePosition};
use crate::stride::TimeStride;

/// Time and sequence of a reading; the configured layout defines which of these exist.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Stamps {
    /// Count of sent readings.
    pub(super) sequence: Option<u64>,
    /// Count of measurements, sent or not.
    pub(super) counter: Option<u64>,
    /// The device's time, ns.
    pub(super) time_ns: Option<u64>,
}

/// Unwraps a count that wraps at `modulus`: steps are at most half a period in either direction.
#[derive(Debug, Clone)]
pub(super) struct Unwrapped {
    modulus: u128,
    newest: Option<(u64, u64)>,
}

impl Unwrapped {
    /// `modulus` is at least 2 and at most 2⁶⁴.
    pub(super) fn new(modulus: u128) -> Unwrapped {
        Unwrapped { modulus, newest: None }
    }

    pub(super) fn take(&mut self, raw: u64) -> u64 {
        let raw = (u128::from(raw) % self.modulus) as u64;
        let unwrapped = match self.newest {
            None => raw,
            Some((before, unwrapped)) => {
                let ahead = (u128::from(raw) + self.modulus - u128::from(before)) % self.modulus;
                if ahead <= self.modulus / 2 {
                    unwrapped.wrapping_add(ahead as u64)
                } else {
                    // A restarted device may count from below its first value.
                    unwrapped.checked_sub((self.modulus - ahead) as u64).unwrap_or(raw)
                }
            }
        };
        self.newest = Some((raw, unwrapped));
        unwrapped
    }
}

/// Whether a time jump may be an artefact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trust {
    /// No checksum, and reordering is possible: a jump is accepted once later times continue from it.
    Doubtful,
    /// In order, and protected by a checksum.
    Proven,
}

/// After a longer silence the loss of a device without a counter cannot be counted.
const SILENCE_NS: u64 = 500_000_000;

/// Orders readings.
#[derive(Debug, Clone)]
pub(super) struct Order {
    sequence: Unwrapped,
    counter: Unwrapped,
    time: Unwrapped,
    trust: Trust,
    timeline: Timeline,
    last_arrival_ns: Option<u64>,
}

impl Order {
    /// For numbers that wrap at these moduli; 2⁶⁴ for a count that does not wrap.
    pub(super) fn new(sequence_modulus: u128, counter_modulus: u128) -> Order {
        Order {
            sequence: Unwrapped::new(sequence_modulus),
            counter: Unwrapped::new(counter_modulus),
            time: Unwrapped::new(1 << 64),
            trust: Trust::Doubtful,
            timeline: Timeline::new(Trust::Doubtful),
            last_arrival_ns: None,
        }
    }

    /// With a time that wraps at this modulus, for [`Self::time_ns`].
    pub(super) fn with_time(self, modulus: u128) -> Order {
        Order { time: Unwrapped::new(modulus), ..self }
    }

    /// For times that arrive in order with a checksum, or without either.
    pub(super) fn trusting(self, trust: Trust) -> Order {
        Order { trust, timeline: Timeline::new(trust), ..self }
    }

    /// The next reading is the first. The device's own counts and time continue.
    pub(super) fn reset(&mut self) {
        self.sequence.newest = None;
        self.timeline = Timeline::new(self.trust);
        self.last_arrival_ns = None;
    }

    /// Registers data of a device without a counter: after a silence its readings begin a new sequence.
    pub(super) fn register_arrival(&mut self, arrival_ns: u64, decoded: &mut Decoded) {
        let before_ns = self.last_arrival_ns.replace(arrival_ns);
        if before_ns.is_some_and(|before_ns| arrival_ns.saturating_sub(before_ns) > SILENCE_NS) {
            decoded.restarted();
        }
    }

    /// The device's time from a wrapping count of its clock, ns.
    pub(super) fn time_ns(&mut self, raw: u64, unit_ns: u64) -> u64 {
        self.time.take(raw).saturating_mul(unit_ns)
    }

    /// Sequence and tick of a reading; reports the loss before it. `None` if it is a duplicate or too late, which is
    /// counted.
    pub(super) fn place(
        &mut self,
        stamps: Stamps,
        arrival_ns: u64,
        decoded: &mut Decoded,
    ) -> Option<(Option<u32>, Tick)> {
        // Truncation is intended: the receiver takes sequences and counters modulo 2³².
        let sequence = stamps.sequence.map(|raw| self.sequence.take(raw) as u32);
        let counter = stamps.counter.map(|raw| self.counter.take(raw) as u32);
        let tick = match (counter, stamps.time_ns, sequence) {
            (Some(counter), _, _) => Tick::Counter(counter),
            (None, Some(time_ns), _) => Tick::Time(time_ns),
            (None, None, Some(sequence)) => Tick::Counter(sequence),
            (None, None, None) => Tick::Uncounted,
        };
        if let (None, Some(time_ns)) = (sequence, stamps.time_ns) {
            let placed = match self.trust {
                Trust::Doubtful => self.timeline.place(time_ns, arrival_ns),
                Trust::Proven => self.timeline.follow(time_ns, arrival_ns),
            };
            match placed {
                Ok(Gap::Lost(0)) => {}
                Ok(Gap::Lost(lost)) => decoded.lost(lost),
                Ok(Gap::Rebooted) => decoded.rebooted(),
                Err(refusal) => {
                    decoded.refuse(refusal);
                    return None;
                }
            }
        }
        Some((sequence, tick))
    }
}

/// Resolution in which times are ordered; a device that stamps two readings within it must number them.
const GRAIN_NS: u64 = 100_000;
/// A datagram that is behind by at most this was overtaken; it is not the first after a restart.
const OVERTAKEN_NS: u64 = 250_000_000;
/// A time that runs ahead by more than this multiple of the host's is not accepted.
const PACE_MAX: u64 = 2;

/// Order and loss of readings that have a time and no number.
#[derive(Debug, Clone)]
struct Timeline {
    order: Sequence,
    newest_ns: Option<u64>,
    lead: Lead,
    stride: TimeStride,
    /// The initial stride, before any reading.
    usual: TimeStride,
}

/// Interval between a time and the preceding one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Gap {
    /// Count of missing readings.
    Lost(u32),
    /// The device's clock restarted.
    Rebooted,
}

impl Timeline {
    fn new(trust: Trust) -> Timeline {
        let grains_per_s = PACE_MAX * 1_000_000_000 / GRAIN_NS;
        // A time with a checksum is the device's own clock; a number in a text may be rounded.
        let stride = match trust {
            Trust::Doubtful => TimeStride::of_rounded(),
            Trust::Proven => TimeStride::of_exact(),
        };
        let order = Sequence::new(grains_per_s).overtaken_by_at_most((OVERTAKEN_NS / GRAIN_NS) as u32);
        Timeline { order, newest_ns: None, lead: Lead::default(), usual: stride.clone(), stride }
    }

    /// The interval before a reading whose time may be wrong.
    fn place(&mut self, time_ns: u64, arrival_ns: u64) -> Result<Gap, GroundRefusal> {
        // Truncation is intended, as for a sequence: only differences count.
        let grain = (time_ns / GRAIN_NS) as u32;
        match self.order.classify(grain, arrival_ns) {
            SequencePosition::Same => Err(GroundRefusal::Duplicate),
            SequencePosition::Old => Err(GroundRefusal::OutOfOrder),
            SequencePosition::Next { .. } => Ok(Gap::Lost(self.lost_before(time_ns))),
            SequencePosition::First => {
                self.begin(time_ns);
                Ok(Gap::Lost(0))
            }
            SequencePosition::NewSession => {
                self.begin(time_ns);
                Ok(Gap::Rebooted)
            }
        }
    }

    /// The interval before a reading whose time is reliable.
    fn follow(&mut self, time_ns: u64, arrival_ns: u64) -> Result<Gap, GroundRefusal> {
        let Some(newest_ns) = self.newest_ns else {
            self.lead.begin(arrival_ns);
            self.begin(time_ns);
            return Ok(Gap::Lost(0));
        };
        if newest_ns == time_ns {
            return Err(GroundRefusal::Duplicate);
        }
        // A wrapping clock that was restarted may appear to leap ahead.
        if newest_ns < time_ns && self.lead.allows(time_ns - newest_ns, arrival_ns) {
            return Ok(Gap::Lost(self.lost_before(time_ns)));
        }
        self.lead.begin(arrival_ns);
        self.begin(time_ns);
        Ok(Gap::Rebooted)
    }

    fn begin(&mut self, time_ns: u64) {
        self.stride = self.usual.clone();
        self.newest_ns = Some(time_ns);
    }

    fn lost_before(&mut self, time_ns: u64) -> u32 {
        let gap_us = time_ns.saturating_sub(self.newest_ns.unwrap_or(time_ns)) / 1000;
        self.newest_ns = Some(time_ns);
        self.stride.lost_in(u32::try_from(gap_us).unwrap_or(u32::MAX).max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NS_PER_MS: u64 = 1_000_000;
    const NONE: Result<Gap, GroundRefusal> = Ok(Gap::Lost(0));

    fn timeline(stamps_ms: &[u64]) -> Vec<Result<Gap, GroundRefusal>> {
        let mut timeline = Timeline::new(Trust::Doubtful);
        let mut arrival_ns = 0;
        let mut place = |stamp_ms: &u64| {
            arrival_ns += 10 * NS_PER_MS;
            timeline.place(stamp_ms * NS_PER_MS, arrival_ns)
        };
        stamps_ms.iter().map(&mut place).collect()
    }

    #[test]
    fn stamps_alone_tell_loss_repetition_and_disorder() {
        use GroundRefusal::{Duplicate, OutOfOrder};
        let got = timeline(&[80, 90, 100, 110, 120, 120, 150, 130, 140, 160]);
        assert_eq!(got[..6], [NONE, NONE, NONE, NONE, NONE, Err(Duplicate)]);
        assert_eq!(got[6..], [Ok(Gap::Lost(2)), Err(OutOfOrder), Err(OutOfOrder), NONE]);
    }

    #[test]
    fn however_many_were_overtaken_the_device_was_not_restarted() {
        let stamps_ms = [70, 80, 90, 100, 110, 160, 120, 130, 140, 150, 170];
        let got = timeline(&stamps_ms);
        assert_eq!(got[5], Ok(Gap::Lost(4)));
        assert_eq!(got[6..10], [Err(GroundRefusal::OutOfOrder); 4]);
        assert_eq!(got[10], NONE);
    }

    #[test]
    fn a_proven_clock_that_restarts_is_recognised_for_a_leap_in_either_direction() {
        for (start_ns, first_ns) in [(70_000 * NS_PER_MS, 0), (3_000_000 * NS_PER_MS, 4_294_967_296_000)] {
            let mut timeline = Timeline::new(Trust::Proven);
            let mut follow =
                |index: u64, time_ns| timeline.follow(time_ns, 9000 * NS_PER_MS + index * 10 * NS_PER_MS);
            for index in 0..10 {
                assert_eq!(follow(index, start_ns + index * 10 * NS_PER_MS), NONE);
            }
            // The device was off for five seconds.
            assert_eq!(follow(510, first_ns), Ok(Gap::Rebooted));
            assert_eq!(follow(511, first_ns + 10 * NS_PER_MS), NONE);
            assert_eq!(follow(513, first_ns + 30 * NS_PER_MS), NONE, "the step is not known again yet");
        }
    }

    #[test]
    fn one_outlier_is_rejected_and_a_restart_is_accepted_at_the_second_step() {
        let got = timeline(&[70, 80, 90, 100, 110, 99_999_120, 130, 140]);
        assert_eq!(got[5..], [Err(GroundRefusal::OutOfOrder), Ok(Gap::Lost(1)), NONE]);
        let got = timeline(&[70_000, 70_010, 0, 10, 20, 30]);
        assert_eq!(got.iter().filter(|placed| placed.is_err()).count(), 2, "{got:?}");
        assert_eq!(got[4..], [Ok(Gap::Rebooted), NONE]);
    }

    proptest! {
        #[test]
        fn a_wrapped_count_is_the_count_where_steps_are_short(
            modulus in 4u64..100_000, start: u32, steps in proptest::collection::vec(0.0..1.0f64, 1..50),
        ) {
            let mut unwrapped = Unwrapped::new(u128::from(modulus));
            let mut count = u64::from(start);
            let first = unwrapped.take(count % modulus);
            for step in steps {
                count += (step * (modulus / 2) as f64) as u64;
                prop_assert_eq!(unwrapped.take(count % modulus) - first, count - u64::from(start));
            }
        }

        #[test]
        fn any_count_is_taken(modulus in 2u128..=1 << 64, counts in proptest::collection::vec(any::<u64>(), 0..20)) {
            let mut unwrapped = Unwrapped::new(modulus);
            for count in counts {
                unwrapped.take(count);
            }
        }
    }
}
