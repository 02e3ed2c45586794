//! Aligns ground and suit samples by sample time, not by arrival: a ring of ground samples, a short queue of suit
//! samples.
//!
//! A suit sample waits until ground samples extend beyond its own time; then the wrench at exactly that time is
//! interpolated. If the ground is silent, the suit sample is released without a wrench.

use bytemuck::{Pod, Zeroable};

use super::tare::Tare;
use crate::message::{GroundSample, Message, SuitSample};
use crate::motion::end_kernel;
use crate::time::NS_PER_S;

/// Ground samples stored: at 1 kHz, half a second for the latency of the suit and half a second for the longest window.
const GROUND_RING: usize = 1024;
/// Suit samples that may wait for the ground: half a second at 240 Hz.
const SUIT_QUEUE: usize = 128;
/// Maximum time that a suit sample waits for the ground, ns.
pub const WAIT_MAX_NS: u64 = 60_000_000;
/// Maximum interval between ground samples for interpolation, ns.
pub const GAP_MAX_NS: u64 = 60_000_000;

/// Queues of both streams.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Alignment {
    ground: [GroundSample; GROUND_RING],
    /// Number of ground samples ingested; the newest is at `(ground_count − 1) % GROUND_RING`.
    ground_count: u64,
    suit: [SuitSample; SUIT_QUEUE],
    /// Numbers of suit samples ingested and released.
    suit_in: u64,
    suit_out: u64,
    /// Estimated sample periods, ns; 0 before two samples.
    suit_period_ns: u64,
    ground_period_ns: u64,
    /// Samples rejected: implausible, or their time did not advance.
    refused: u64,
    /// Delay of the suit's stamps relative to the ground's, ns: the suit's t corresponds to the ground's t − lag.
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

/// Averaging time of a tare, ns.
const TARE_SPAN_NS: u64 = 300_000_000;
/// Upper bound of a sample period, ns; no supported sensor is slower.
const PERIOD_MAX_NS: u64 = 100_000_000;
/// More samples than arrive in a century.
const COUNT_MAX: u64 = 1 << 48;

/// Initial period: that of the slowest supported suit and plate, ns.
const PERIOD_INITIAL_NS: u64 = 16_666_667;

/// Updates the period with a quarter of each new interval, but not with gaps.
fn update_period(period_ns: &mut u64, interval_ns: u64) {
    if *period_ns == 0 {
        *period_ns = interval_ns;
    } else if interval_ns < 2 * *period_ns {
        *period_ns = (3 * *period_ns + interval_ns) / 4;
    } else {
        // A gap, or the stream became slower: adapt slowly.
        *period_ns += *period_ns / 16;
    }
    *period_ns = (*period_ns).min(PERIOD_MAX_NS);
}

impl Alignment {
    /// Whether a ground sample may enter at `now_ns`: its numbers are possible, its time advances and is not in the
    /// future. Counts rejected samples. The adapters check this too; the loop checks again, because any process of the
    /// same user may write to the bus.
    pub fn admits_ground(&mut self, sample: &GroundSample, now_ns: u64) -> bool {
        let advances =
            self.newest_ground().is_none_or(|newest| sample.sample_time_ns > newest.sample_time_ns);
        self.admit(advances && is_not_in_future(sample.sample_time_ns, now_ns) && sample.is_possible())
    }

    /// Likewise for a suit sample.
    pub fn admits_suit(&mut self, sample: &SuitSample, now_ns: u64) -> bool {
        let advances = self.newest_suit().is_none_or(|newest| sample.sample_time_ns > newest.sample_time_ns);
        self.admit(advances && is_not_in_future(sample.sample_time_ns, now_ns) && sample.is_possible())
    }

    fn admit(&mut self, may_enter: bool) -> bool {
        self.refused += u64::from(!may_enter);
        may_enter
    }

    /// Appends an admitted ground sample.
    pub fn push_ground(&mut self, sample: &GroundSample) {
        if let Some(newest_ns) = self.newest_ground().map(|newest| newest.sample_time_ns) {
            update_period(&mut self.ground_period_ns, sample.sample_time_ns - newest_ns);
        }
        self.ground[self.ground_count as usize % GROUND_RING] = *sample;
        self.ground_count += 1;
    }

    /// Appends an admitted suit sample. A full queue drops its oldest.
    pub fn push_suit(&mut self, sample: &SuitSample) {
        if let Some(newest_ns) = self.newest_suit().map(|newest| newest.sample_time_ns) {
            update_period(&mut self.suit_period_ns, sample.sample_time_ns - newest_ns);
        }
        self.suit[self.suit_in as usize % SUIT_QUEUE] = *sample;
        self.suit_in += 1;
        self.suit_out = self.suit_out.max(self.suit_in.saturating_sub(SUIT_QUEUE as u64));
    }

    /// Drops the suit samples that wait for the ground.
    pub(super) fn drop_waiting(&mut self) {
        self.suit_out = self.suit_in;
    }

    /// Sets the delay of the suit's stamps relative to the ground's, ns.
    pub(super) fn set_lag_ns(&mut self, lag_ns: i64) {
        self.lag_ns = lag_ns;
    }

    /// Additional waiting time of a suit sample if the ground's stamps are late, ns.
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

    /// Mean plate reading of the last 0.3 s; `None` unless all of them are sound and their vertical force is below
    /// `empty_n`.
    pub(super) fn empty_reading(&self, empty_n: f64) -> Option<Tare> {
        let newest_ns = self.newest_ground()?.sample_time_ns;
        let filled = (self.ground_count as usize).min(GROUND_RING);
        let is_recent =
            |sample: &&GroundSample| newest_ns.saturating_sub(sample.sample_time_ns) <= TARE_SPAN_NS;
        let recent = || self.ground[..filled].iter().filter(is_recent);
        let is_empty = recent().all(|sample| sample.device_status == 0 && sample.force_n[2].abs() < empty_n);
        is_empty.then(|| Tare::mean_of(recent()))
    }

    /// Subtracts [`Self::empty_reading`] from every sample of the ring and returns it.
    pub(super) fn tare(&mut self, empty_n: f64) -> Option<Tare> {
        let tare = self.empty_reading(empty_n)?;
        let filled = (self.ground_count as usize).min(GROUND_RING);
        for sample in &mut self.ground[..filled] {
            *sample = tare.subtract_from(sample);
        }
        Some(tare)
    }

    /// Initialises the suit's period until samples update it.
    pub(super) fn expect_suit_period(&mut self, period_ns: u64) {
        self.suit_period_ns = period_ns.min(PERIOD_MAX_NS);
    }

    /// Estimated period of the suit, ns.
    pub fn suit_period_ns(&self) -> u64 {
        if self.suit_period_ns == 0 { PERIOD_INITIAL_NS } else { self.suit_period_ns }
    }

    /// Estimated period of the ground, ns.
    pub fn ground_period_ns(&self) -> u64 {
        if self.ground_period_ns == 0 { PERIOD_INITIAL_NS } else { self.ground_period_ns }
    }

    /// Samples rejected: implausible, or their time did not advance.
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
            && self.suit.iter().all(Message::is_finite)
            && self.ground.iter().all(Message::is_finite)
    }

    /// The oldest waiting suit sample, once the ground extends beyond the corresponding time or the sample is
    /// `wait_max_ns` old at `now_ns`.
    pub fn next(&mut self, now_ns: u64, wait_max_ns: u64) -> Option<Aligned> {
        if self.suit_out == self.suit_in {
            return None;
        }
        let suit = self.suit[self.suit_out as usize % SUIT_QUEUE];
        let time_ns = suit.sample_time_ns.saturating_add_signed(-self.lag_ns);
        let reached = self.newest_ground().is_some_and(|ground| ground.sample_time_ns >= time_ns);
        if !reached && now_ns.saturating_sub(suit.sample_time_ns) < wait_max_ns {
            return None;
        }
        self.suit_out += 1;
        Some(Aligned { suit, ground: if reached { self.ground_at(time_ns) } else { None } })
    }

    /// The wrench around a time, averaged as [`crate::motion::History`] averages accelerations: the second derivative
    /// of the least-squares parabola over ±T is the mean of the second derivative with the weights (1 − (t/T)²)². With
    /// the same filter on both sides, motion too fast for the suit cancels in the difference. `None` if samples are
    /// missing or measure different components.
    pub(super) fn ground_around(&self, time_ns: u64, half_ns: u64) -> Option<GroundSample> {
        self.ground_mean(time_ns, [half_ns; 2], |offset_ns| {
            let fraction = offset_ns as f64 / half_ns as f64;
            (1.0 - fraction * fraction) * (1.0 - fraction * fraction)
        })
    }

    /// Likewise at the end of the last `span_ns`, with the weights of [`end_kernel`].
    pub(super) fn ground_before(&self, time_ns: u64, span_ns: u64) -> Option<GroundSample> {
        self.ground_mean(time_ns, [span_ns, 0], |offset_ns| end_kernel(offset_ns as f64 / span_ns as f64))
    }

    /// Mean of the wrench from `before_ns` before a time to `after_ns` after it, weighted by the distance from it. Each
    /// sample represents half the interval to each neighbour, so that lost samples do not shift the mean.
    fn ground_mean(
        &self,
        time_ns: u64,
        [before_ns, after_ns]: [u64; 2],
        weight: impl Fn(u64) -> f64,
    ) -> Option<GroundSample> {
        let slack_ns = 2 * self.ground_period_ns();
        let oldest = self.ground_count.saturating_sub(GROUND_RING as u64);
        let newest_first = (oldest..self.ground_count).rev().map(|i| &self.ground[i as usize % GROUND_RING]);
        let mut within = newest_first
            .skip_while(|sample| sample.sample_time_ns > time_ns + after_ns)
            .take_while(|sample| sample.sample_time_ns + before_ns >= time_ns)
            .peekable();
        let last = **within.peek()?;
        let (mut mean, mut first_ns) = (WeightedMean::of(&last), last.sample_time_ns);
        let (period_ns, mut newer_gap_ns) = (self.ground_period_ns().max(1), None);
        while let Some(sample) = within.next() {
            first_ns = sample.sample_time_ns;
            let older_gap_ns = within.peek().map(|older| first_ns - older.sample_time_ns);
            if older_gap_ns.is_some_and(|gap_ns| gap_ns > GAP_MAX_NS) || !mean.is_alike(sample) {
                return None;
            }
            let interval_ns = newer_gap_ns.unwrap_or(period_ns) + older_gap_ns.unwrap_or(period_ns);
            mean.add(sample, weight(first_ns.abs_diff(time_ns)) * interval_ns as f64);
            newer_gap_ns = older_gap_ns;
        }
        let is_covered = first_ns <= (time_ns + slack_ns).saturating_sub(before_ns)
            && last.sample_time_ns + slack_ns >= time_ns + after_ns;
        is_covered.then(|| mean.sample(time_ns)).flatten()
    }

    /// The wrench at a time between two samples of the ring whose interval is short enough.
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
        let fraction = if span == 0 { 0.0 } else { (time_ns - earlier.sample_time_ns) as f64 / span as f64 };
        let between = GroundSample { sample_time_ns: time_ns, ..earlier.between(later, fraction) };
        Some(between.mask_unmeasured())
    }
}

/// A weighted mean of ground samples that measure the same components.
struct WeightedMean {
    kind: GroundSample,
    weights: f64,
    force_n: [f64; 3],
    moment_nm: [f64; 3],
    foot_vertical_n: [f64; 2],
    /// CoP times force of each foot: the moments are the quantities measured.
    foot_moment_nm: [[f64; 2]; 2],
}

impl WeightedMean {
    fn of(kind: &GroundSample) -> WeightedMean {
        WeightedMean {
            kind: *kind,
            weights: 0.0,
            force_n: [0.0; 3],
            moment_nm: [0.0; 3],
            foot_vertical_n: [0.0; 2],
            foot_moment_nm: [[0.0; 2]; 2],
        }
    }

    /// Whether a sample measures the same components by the same devices, without a fault.
    fn is_alike(&self, sample: &GroundSample) -> bool {
        let measures =
            |of: &GroundSample| (of.not_measured, of.devices, of.per_foot, of.foot_frame, of.device_status);
        measures(sample) == measures(&self.kind) && sample.device_status == 0
    }

    fn add(&mut self, sample: &GroundSample, weight: f64) {
        self.weights += weight;
        for axis in 0..3 {
            self.force_n[axis] += weight * sample.force_n[axis];
            self.moment_nm[axis] += weight * sample.moment_nm[axis];
        }
        for foot in 0..2 {
            let vertical_n = weight * sample.foot_vertical_n[foot];
            self.foot_vertical_n[foot] += vertical_n;
            for axis in 0..2 {
                self.foot_moment_nm[foot][axis] += vertical_n * sample.foot_cop_m[foot][axis];
            }
        }
    }

    fn sample(&self, time_ns: u64) -> Option<GroundSample> {
        let is_pressed = |foot: usize| self.foot_vertical_n[foot].abs() > 1e-6;
        (self.weights > 0.0).then(|| GroundSample {
            sample_time_ns: time_ns,
            force_n: self.force_n.map(|sum| sum / self.weights),
            moment_nm: self.moment_nm.map(|sum| sum / self.weights),
            foot_vertical_n: self.foot_vertical_n.map(|sum| sum / self.weights),
            foot_cop_m: core::array::from_fn(|foot| {
                let cop_m = self.foot_moment_nm[foot].map(|sum| sum / self.foot_vertical_n[foot]);
                if is_pressed(foot) { cop_m } else { [0.0; 2] }
            }),
            ..self.kind
        })
    }
}

/// A sample dated farther ahead of the cycle is rejected: it would make all later ones appear old, ns.
const AHEAD_MAX_NS: u64 = 1_000_000_000;

fn is_not_in_future(sample_time_ns: u64, now_ns: u64) -> bool {
    sample_time_ns <= now_ns.saturating_add(AHEAD_MAX_NS)
}

#[cfg(test)]
mod tests;
