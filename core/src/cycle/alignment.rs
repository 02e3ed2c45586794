//! Ground to suit by sample time, never by arrival: a ring of ground samples, a short queue of suit samples.
//!
//! A suit sample waits until ground samples reach past its own time; then the wrench at exactly that time is
//! interpolated. If the ground stays silent, the suit sample goes on alone.

use bytemuck::{Pod, Zeroable};

use super::tare::Tare;
use crate::message::{GroundSample, SuitSample};
use crate::time::NS_PER_S;

/// Ground samples kept: 0.64 s at 1 kHz, for a suit that is half a second late.
const GROUND_RING: usize = 640;
/// Suit samples that may wait for the ground: half a second at 240 Hz.
const SUIT_QUEUE: usize = 128;
/// How long a suit sample waits for the ground, ns.
pub const PATIENCE_NS: u64 = 60_000_000;
/// Ground samples farther apart than this are not interpolated between, ns.
const GAP_MAX_NS: u64 = 60_000_000;

/// Both streams, waiting for each other.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Alignment {
    ground: [GroundSample; GROUND_RING],
    /// How many ground samples were taken in; the newest is at `(ground_count − 1) % GROUND_RING`.
    ground_count: u64,
    suit: [SuitSample; SUIT_QUEUE],
    /// How many suit samples were taken in, and how many have left.
    suit_in: u64,
    suit_out: u64,
    /// Learnt sample periods, ns; 0 before two samples.
    suit_period_ns: u64,
    ground_period_ns: u64,
    /// Samples refused: not plausible, or their time did not advance.
    refused: u64,
    /// How much later than the ground's the suit's stamps are, ns: the suit's t belongs to the ground's t − lag.
    lag_ns: i64,
}

/// A suit sample with the ground's wrench at its time.
#[derive(Debug, Clone, Copy)]
pub struct Aligned {
    /// The suit sample.
    pub suit: SuitSample,
    /// The wrench at the suit's sample time; `None` if the ground was silent then.
    pub ground: Option<GroundSample>,
}

/// How much of the plate's recent past is averaged for a tare, ns.
const TARE_SPAN_NS: u64 = 300_000_000;
/// No supported sensor is slower, ns.
const PERIOD_MAX_NS: u64 = 100_000_000;
/// More samples than a century brings.
const COUNT_MAX: u64 = 1 << 48;

/// Before two samples were seen: the slowest suit and plate that are supported, ns.
const PERIOD_AT_FIRST_NS: u64 = 16_666_667;

/// A quarter of each new interval enters the learnt period; gaps do not.
fn learn(period_ns: &mut u64, interval_ns: u64) {
    if *period_ns == 0 {
        *period_ns = interval_ns;
    } else if interval_ns < 2 * *period_ns {
        *period_ns = (3 * *period_ns + interval_ns) / 4;
    } else {
        // A gap, or the stream became slower: follow slowly.
        *period_ns += *period_ns / 16;
    }
    *period_ns = (*period_ns).min(PERIOD_MAX_NS);
}

impl Alignment {
    /// Takes in a ground sample; one that is not plausible at `now_ns` or whose time does not advance is refused.
    /// Returns whether it was accepted.
    pub fn push_ground(&mut self, sample: &GroundSample, now_ns: u64) -> bool {
        if !is_sound_ground(sample, now_ns) {
            self.refused += 1;
            return false;
        }
        if let Some(newest_ns) = self.newest_ground().map(|newest| newest.sample_time_ns) {
            if sample.sample_time_ns <= newest_ns {
                self.refused += 1;
                return false;
            }
            learn(&mut self.ground_period_ns, sample.sample_time_ns - newest_ns);
        }
        self.ground[self.ground_count as usize % GROUND_RING] = *sample;
        self.ground_count += 1;
        true
    }

    /// Takes in a suit sample; one that is not plausible at `now_ns` or whose time does not advance is refused. A full
    /// queue loses its oldest. Returns whether it was accepted.
    pub fn push_suit(&mut self, sample: &SuitSample, now_ns: u64) -> bool {
        if !is_sound_suit(sample, now_ns) {
            self.refused += 1;
            return false;
        }
        if let Some(newest_ns) = self.newest_suit().map(|newest| newest.sample_time_ns) {
            if sample.sample_time_ns <= newest_ns {
                self.refused += 1;
                return false;
            }
            learn(&mut self.suit_period_ns, sample.sample_time_ns - newest_ns);
        }
        self.suit[self.suit_in as usize % SUIT_QUEUE] = *sample;
        self.suit_in += 1;
        self.suit_out = self.suit_out.max(self.suit_in.saturating_sub(SUIT_QUEUE as u64));
        true
    }

    /// Sets how much later than the ground's the suit's stamps are, ns.
    pub(super) fn set_lag_ns(&mut self, lag_ns: i64) {
        self.lag_ns = lag_ns;
    }

    /// How much longer a suit sample waits because the ground's stamps are late, ns.
    pub(super) fn ground_late_ns(&self) -> u64 {
        (-self.lag_ns).max(0) as u64
    }

    /// The newest ground sample.
    pub fn newest_ground(&self) -> Option<&GroundSample> {
        let index = self.ground_count.checked_sub(1)?;
        Some(&self.ground[index as usize % GROUND_RING])
    }

    /// The newest suit sample.
    pub fn newest_suit(&self) -> Option<&SuitSample> {
        let index = self.suit_in.checked_sub(1)?;
        Some(&self.suit[index as usize % SUIT_QUEUE])
    }

    /// What the plate showed on average over the last 0.3 s, taken off every sample of the ring; `None`, and nothing
    /// is changed, unless all of them are sound and show less than `empty_n` of vertical force.
    pub(super) fn tare(&mut self, empty_n: f64) -> Option<Tare> {
        let newest_ns = self.newest_ground()?.sample_time_ns;
        let filled = (self.ground_count as usize).min(GROUND_RING);
        let is_recent =
            |sample: &&GroundSample| newest_ns.saturating_sub(sample.sample_time_ns) <= TARE_SPAN_NS;
        let recent = || self.ground[..filled].iter().filter(is_recent);
        if recent().any(|sample| sample.device_status != 0 || sample.force_n[2].abs() >= empty_n) {
            return None;
        }
        let shown = Tare::shown_by(recent());
        for sample in &mut self.ground[..filled] {
            *sample = shown.off(sample);
        }
        Some(shown)
    }

    /// Believes a period of the suit until samples show another.
    pub(super) fn expect_suit_period(&mut self, period_ns: u64) {
        self.suit_period_ns = period_ns.min(PERIOD_MAX_NS);
    }

    /// Learnt period of the suit, ns.
    pub fn suit_period_ns(&self) -> u64 {
        if self.suit_period_ns == 0 { PERIOD_AT_FIRST_NS } else { self.suit_period_ns }
    }

    /// Learnt period of the ground, ns.
    pub fn ground_period_ns(&self) -> u64 {
        if self.ground_period_ns == 0 { PERIOD_AT_FIRST_NS } else { self.ground_period_ns }
    }

    /// Samples refused: not plausible, or their time did not advance.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Whether counters are in range; a stored alignment is checked before use.
    pub fn is_sound(&self) -> bool {
        self.suit_out <= self.suit_in
            && self.suit_in - self.suit_out <= SUIT_QUEUE as u64
            && self.suit_in < COUNT_MAX
            && self.ground_count < COUNT_MAX
            && self.suit_period_ns <= PERIOD_MAX_NS
            && self.ground_period_ns <= PERIOD_MAX_NS
            && self.lag_ns.unsigned_abs() <= NS_PER_S
            && self.suit.iter().all(is_finite_suit)
            && self.ground.iter().all(is_finite_ground)
    }

    /// The oldest waiting suit sample, once the ground reaches past the time that belongs to it or it is `patience_ns` old at `now_ns`.
    pub fn next(&mut self, now_ns: u64, patience_ns: u64) -> Option<Aligned> {
        if self.suit_out == self.suit_in {
            return None;
        }
        let suit = self.suit[self.suit_out as usize % SUIT_QUEUE];
        let time_ns = suit.sample_time_ns.saturating_add_signed(-self.lag_ns);
        let reached = self.newest_ground().is_some_and(|ground| ground.sample_time_ns >= time_ns);
        if !reached && now_ns.saturating_sub(suit.sample_time_ns) < patience_ns {
            return None;
        }
        self.suit_out += 1;
        Some(Aligned { suit, ground: if reached { self.ground_at(time_ns) } else { None } })
    }

    /// The wrench at a time between two samples of the ring that are not too far apart.
    fn ground_at(&self, time_ns: u64) -> Option<GroundSample> {
        let oldest = self.ground_count.saturating_sub(GROUND_RING as u64);
        let at = |index: u64| &self.ground[index as usize % GROUND_RING];
        let mut after = self.ground_count.checked_sub(1)?;
        while after > oldest && at(after - 1).sample_time_ns >= time_ns {
            after -= 1;
        }
        let (later, earlier) = (at(after), if after > oldest { at(after - 1) } else { at(after) });
        if earlier.sample_time_ns > time_ns || later.sample_time_ns - earlier.sample_time_ns > GAP_MAX_NS {
            return (later.sample_time_ns == time_ns).then_some(*later);
        }
        let span = later.sample_time_ns - earlier.sample_time_ns;
        let share = if span == 0 { 0.0 } else { (time_ns - earlier.sample_time_ns) as f64 / span as f64 };
        let between = GroundSample { sample_time_ns: time_ns, ..earlier.between(later, share) };
        Some(between.without_what_was_not_measured())
    }
}

fn is_finite_suit(sample: &SuitSample) -> bool {
    sample.position_m.iter().flatten().all(|value| value.is_finite())
        && sample.orientation_wxyz.iter().flatten().all(|value| value.is_finite())
        && sample.com_m.iter().all(|value| value.is_finite())
        && sample.acceleration_m_per_s2.iter().flatten().all(|value| value.is_finite())
}

fn is_finite_ground(sample: &GroundSample) -> bool {
    sample.force_n.iter().chain(&sample.moment_nm).all(|value| value.is_finite())
        && sample.surface_z_m.is_finite()
        && sample
            .foot_vertical_n
            .iter()
            .chain(sample.foot_cop_m.iter().flatten())
            .all(|value| value.is_finite())
}

/// A sample dated farther ahead of the cycle than this is not believed: it would make all later ones look old, ns.
const AHEAD_MAX_NS: u64 = 1_000_000_000;
/// No body is farther from the origin, m.
const POSITION_MAX_M: f64 = 1e4;
/// No plate measures more, N and N m.
const WRENCH_MAX: f64 = 1e6;

/// Whether a suit sample may enter at `now_ns`: plausible numbers, unit quaternions, a time that is not to come.
///
/// Adapters see to that; the loop checks again, because any process of the same user may write to the bus.
fn is_sound_suit(sample: &SuitSample, now_ns: u64) -> bool {
    is_not_to_come(sample.sample_time_ns, now_ns)
        && is_finite_suit(sample)
        && sample.position_m.iter().flatten().all(|metres| metres.abs() < POSITION_MAX_M)
        && sample.orientation_wxyz.iter().all(|q| {
            let square: f64 = q.iter().map(|part| part * part).sum();
            (square - 1.0).abs() < 1e-3
        })
}

/// Whether a ground sample may enter at `now_ns`: plausible numbers, a time that is not to come.
fn is_sound_ground(sample: &GroundSample, now_ns: u64) -> bool {
    is_not_to_come(sample.sample_time_ns, now_ns)
        && is_finite_ground(sample)
        && sample.force_n.iter().chain(&sample.moment_nm).all(|value| value.abs() < WRENCH_MAX)
        && sample.surface_z_m.abs() < POSITION_MAX_M
}

fn is_not_to_come(sample_time_ns: u64, now_ns: u64) -> bool {
    sample_time_ns <= now_ns.saturating_add(AHEAD_MAX_NS)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Late enough for every sample here.
    const NOW_NS: u64 = 1 << 40;

    fn ground(time_ns: u64, force: f64) -> GroundSample {
        GroundSample { sample_time_ns: time_ns, force_n: [0.0, 0.0, force], ..Zeroable::zeroed() }
    }

    fn suit(time_ns: u64) -> SuitSample {
        SuitSample {
            sample_time_ns: time_ns,
            orientation_wxyz: [[1.0, 0.0, 0.0, 0.0]; crate::body::SEGMENTS],
            ..Zeroable::zeroed()
        }
    }

    fn empty() -> Alignment {
        Zeroable::zeroed()
    }

    #[test]
    fn the_wrench_is_taken_at_the_suit_s_own_time_whatever_arrived_first() {
        let mut alignment = empty();
        alignment.push_suit(&suit(1_500_000), NOW_NS);
        assert!(alignment.next(2_000_000, PATIENCE_NS).is_none(), "the ground has not reached it");
        for millisecond in 0..3 {
            alignment.push_ground(&ground(millisecond * 1_000_000, 100.0 * millisecond as f64), NOW_NS);
        }
        let aligned = alignment.next(3_000_000, PATIENCE_NS).unwrap();
        assert!((aligned.ground.unwrap().force_n[2] - 150.0).abs() < 1e-9);
        assert!(alignment.next(3_000_000, PATIENCE_NS).is_none());
    }

    #[test]
    fn a_lag_takes_the_wrench_from_another_time_and_waits_for_it() {
        let mut alignment = empty();
        for millisecond in 0..500 {
            alignment.push_ground(&ground(millisecond * 1_000_000, millisecond as f64), NOW_NS);
        }
        let mut at = |lag_ms: i64, suit_ms: u64| {
            alignment.set_lag_ns(lag_ms * 1_000_000);
            alignment.push_suit(&suit(suit_ms * 1_000_000), NOW_NS);
            let aligned = alignment.next(500_000_000, PATIENCE_NS + alignment.ground_late_ns())?;
            assert_eq!(aligned.suit.sample_time_ns, suit_ms * 1_000_000, "the stamp stays");
            Some(aligned.ground?.force_n[2].round())
        };
        assert_eq!(at(0, 200), Some(200.0));
        assert_eq!(at(138, 210), Some(72.0), "a late suit");
        assert_eq!(at(-138, 220), Some(358.0), "a late ground");
        // Ground that reaches to 499 ms is 138 ms short of it; the sample is 80 ms old.
        assert_eq!(at(-138, 420), None);
        assert_eq!(
            alignment.next(500_000_000, PATIENCE_NS).map(|aligned| aligned.ground.is_none()),
            Some(true)
        );
    }

    #[test]
    fn a_ground_that_is_half_a_second_late_is_waited_for_at_240_hz() {
        let mut alignment = empty();
        alignment.set_lag_ns(-500_000_000);
        let mut told = 0;
        for millisecond in 1..2000_u64 {
            let now_ns = millisecond * 1_000_000;
            alignment.push_ground(&ground(now_ns, 700.0), now_ns);
            if now_ns % 4_166_667 < 1_000_000 {
                alignment.push_suit(&suit(now_ns), now_ns);
            }
            while let Some(aligned) = alignment.next(now_ns, PATIENCE_NS + alignment.ground_late_ns()) {
                assert!(aligned.ground.is_some());
                told += 1;
            }
        }
        assert!((357..=360).contains(&told), "1.5 s at 240 Hz, none lost: {told}");
    }

    #[test]
    fn a_silent_ground_does_not_hold_the_suit_back_for_ever() {
        let mut alignment = empty();
        alignment.push_ground(&ground(0, 700.0), NOW_NS);
        alignment.push_suit(&suit(10_000_000), NOW_NS);
        assert!(alignment.next(20_000_000, PATIENCE_NS).is_none());
        assert!(alignment.next(80_000_000, PATIENCE_NS).unwrap().ground.is_none());
    }

    #[test]
    fn what_one_of_two_samples_did_not_measure_is_not_measured_between_them() {
        use crate::message::{Component, GroundDevice};
        let mut alignment = empty();
        let insoles = GroundDevice::Insoles as u32;
        let without = Component::Shear as u32;
        let blind = GroundSample { not_measured: without, devices: insoles, ..ground(0, 700.0) };
        alignment.push_ground(&blind, NOW_NS);
        alignment.push_ground(&GroundSample { devices: 1, ..ground(1_000_000, 700.0) }, NOW_NS);
        alignment.push_suit(&suit(500_000), NOW_NS);
        let between = alignment.next(2_000_000, PATIENCE_NS).unwrap().ground.unwrap();
        assert!(!between.measures(Component::Shear));
        assert_eq!(between.devices, 1 | insoles);
    }

    #[test]
    fn nothing_is_interpolated_over_a_gap() {
        let mut alignment = empty();
        alignment.push_ground(&ground(0, 700.0), NOW_NS);
        alignment.push_ground(&ground(200_000_000, 700.0), NOW_NS);
        alignment.push_suit(&suit(100_000_000), NOW_NS);
        assert!(alignment.next(200_000_000, PATIENCE_NS).unwrap().ground.is_none());
    }

    #[test]
    fn time_that_does_not_advance_is_refused() {
        let mut alignment = empty();
        alignment.push_ground(&ground(5, 1.0), NOW_NS);
        alignment.push_ground(&ground(5, 2.0), NOW_NS);
        alignment.push_ground(&ground(4, 3.0), NOW_NS);
        alignment.push_suit(&suit(9), NOW_NS);
        alignment.push_suit(&suit(9), NOW_NS);
        assert_eq!(alignment.refused(), 3);
        assert_eq!(alignment.newest_ground().unwrap().force_n[2], 1.0);
    }

    #[test]
    fn a_tare_takes_the_last_moments_of_an_empty_plate_and_is_not_taken_twice() {
        let mut alignment = empty();
        for millisecond in 0..500 {
            let force = if millisecond < 100 { 706.0 } else { 30.0 };
            alignment.push_ground(&ground(millisecond * 1_000_000, force), NOW_NS);
        }
        let shown = alignment.tare(150.0).unwrap();
        assert!((shown.force_n[2] - 30.0).abs() < 1e-9, "{shown:?}");
        assert!(alignment.tare(150.0).unwrap().force_n[2].abs() < 1e-9, "the second tare finds nothing left");
        alignment.push_ground(&ground(500 * 1_000_000, 400.0), NOW_NS);
        assert!(alignment.tare(150.0).is_none(), "somebody steps on");
    }

    #[test]
    fn a_full_queue_loses_its_oldest() {
        let mut alignment = empty();
        for index in 1..=SUIT_QUEUE as u64 + 3 {
            alignment.push_suit(&suit(index), NOW_NS);
        }
        assert_eq!(alignment.next(u64::MAX, PATIENCE_NS).unwrap().suit.sample_time_ns, 4);
        assert!(alignment.is_sound());
    }

    #[test]
    fn the_period_is_learnt_and_a_gap_is_not_a_period() {
        let mut alignment = empty();
        let mut time_ns = 0;
        for _ in 0..20 {
            time_ns += 4_166_667;
            alignment.push_suit(&suit(time_ns), NOW_NS);
        }
        alignment.push_suit(&suit(time_ns + 500_000_000), NOW_NS);
        assert!(alignment.suit_period_ns() < 5_000_000);
    }
}
