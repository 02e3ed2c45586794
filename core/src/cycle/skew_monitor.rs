//! Estimates the skew between both streams, and sets the lag by which the alignment corrects it.

use bytemuck::{Pod, Zeroable};

use super::settings::{Motion, Settings};
use super::validity::CLOCK_SIGMA_MAX_S;
use crate::body::{Anthropometry, SEGMENTS};
use crate::math;
use crate::message::{GroundSample, SuitSample};
use crate::static_pose::SPAN_NS;
use crate::time::{Skew, SkewEstimator};

/// An estimate with a larger 1-σ is not published and does not set the first lag, s: beyond it the alignment would be
/// invalid.
const PRECISE_SIGMA_S: f64 = OFF_MIN_S;
/// Deviation at which the lag is set again, s: half a sample of the fastest suit.
const RESET_MIN_S: f64 = 0.002;
/// The alignment is invalid if the lag is off by this many σ …
const OFF_SIGMAS: f64 = 3.0;
/// … and by this much, s: at 0.3 m/s, a brisk shift of the weight, 10 ms move the centre of pressure by 3 mm.
const OFF_MIN_S: f64 = 0.010;
/// Upper bound of the lag, s.
pub(super) const LAG_MAX_S: f64 = 1.0;
/// The lag changes by at most this much per second of the suit's time, s/s: a step then releases at most two waiting
/// suit samples for each that arrives.
const SLEW: f64 = 0.5;

/// The estimator and the lag in use.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SkewMonitor {
    estimator: SkewEstimator,
    /// 1 from a change of a stream's clock epoch until the lag is measured again; 0 if it never was.
    is_unknown: u64,
    /// 1 once a lag was measured or restored.
    was_measured: u64,
    /// Target of the lag and the lag in use, s: positive if the suit is late.
    target_s: f64,
    applied_s: f64,
    /// Lag of the model, already subtracted from the stamps, s.
    model_lag_s: f64,
    /// Time of the newest suit sample, ns.
    time_ns: u64,
    /// 1 while the data contradict the lag in use.
    is_off: u64,
    /// Skew and its 1-σ at the newest suit sample, s; zero while the estimate is too uncertain.
    published_s: f64,
    published_sigma_s: f64,
}

impl SkewMonitor {
    /// Ingests a ground sample; one that reports a fault counts as a gap.
    pub(super) fn ingest_ground(&mut self, ground: &GroundSample) {
        if ground.device_status == 0 {
            self.estimator.push_force(ground.sample_time_ns, ground.force_n[2]);
        }
    }

    /// Ingests the height of the CoM, m, and sets the lag if `is_wanted`. Returns whether this is the first lag of the
    /// session and a large one: all motion so far was aligned wrongly.
    fn ingest_suit(&mut self, time_ns: u64, height_m: f64, is_wanted: bool) -> bool {
        self.estimator.push_height(time_ns, height_m);
        let step_s = if self.time_ns == 0 { 0.0 } else { time_ns.saturating_sub(self.time_ns) as f64 * 1e-9 };
        self.time_ns = time_ns;
        if !is_wanted {
            (self.target_s, self.applied_s, self.is_off, self.is_unknown) = (0.0, 0.0, 0, 0);
            return false;
        }
        let tracked = self.estimator.at(time_ns);
        let is_precise = u64::from(tracked.as_ref().is_some_and(Skew::is_precise));
        self.is_unknown &= 1 - is_precise;
        self.was_measured |= is_precise;
        let is_first = self.target_s == 0.0;
        // Clocks drift, so a new estimate is better than the lag in use even if it is less precise. After hours without
        // motion it extrapolates the drift by seconds and is not used.
        let is_usable = |skew: &Skew| match is_first {
            true => skew.is_precise(),
            false => skew.sigma_s < CLOCK_SIGMA_MAX_S && skew.skew_s.abs() < LAG_MAX_S,
        };
        if let Some(Skew { skew_s, .. }) = tracked.filter(is_usable)
            && (skew_s - self.target_s).abs() > RESET_MIN_S
        {
            self.target_s = skew_s;
        }
        let step_max_s = SLEW * step_s;
        self.applied_s += (self.target_s - self.applied_s).clamp(-step_max_s, step_max_s);
        let off_s = |skew_s: f64| (skew_s - self.applied_s).abs();
        self.is_off = u64::from(match (tracked, self.estimator.tentative_s()) {
            _ if self.is_unknown == 1 => true,
            (Some(Skew { skew_s, sigma_s, .. }), _) => off_s(skew_s) > (OFF_SIGMAS * sigma_s).max(OFF_MIN_S),
            (None, Some(skew_s)) => off_s(skew_s) > 2.0 * OFF_MIN_S,
            (None, None) => false,
        });
        is_first && self.target_s.abs() > OFF_MIN_S
    }

    /// Compares sequence number and clock epoch of two samples of one stream. If the epoch changed, no earlier window
    /// determines the lag: the estimator restarts. A lower number is that of a restarted adapter, whose epochs begin
    /// again. Without an earlier measurement the lag of the model applies alone, as at the start.
    pub(super) fn compare_epochs(&mut self, [before, now]: [(u64, u32); 2]) {
        if before.1 != now.1 && before.0 <= now.0 {
            self.is_unknown = self.was_measured;
            self.estimator = Zeroable::zeroed();
        }
    }

    /// Restores a stored lag, s, of which the model subtracts a part; 0 if it was not measured.
    pub(super) fn resume(&mut self, total_lag_s: f64, model_lag_s: f64) {
        let lag_s = if total_lag_s == 0.0 { 0.0 } else { in_range(total_lag_s - model_lag_s) };
        (self.target_s, self.applied_s, self.model_lag_s) = (lag_s, lag_s, model_lag_s);
        self.was_measured = u64::from(lag_s != 0.0);
    }

    /// Replaces the lag of the model, s. A measured lag remains the same in total; without a measurement that of the
    /// model applies alone. Returns whether it differs from the previous one.
    pub(super) fn replace_model_lag(&mut self, model_lag_s: f64) -> bool {
        let by_s = model_lag_s - self.model_lag_s;
        if self.is_measured() {
            (self.target_s, self.applied_s) =
                (in_range(self.target_s - by_s), in_range(self.applied_s - by_s));
        }
        if by_s != 0.0 {
            self.estimator.shift_heights(by_s);
        }
        self.model_lag_s = model_lag_s;
        by_s != 0.0
    }

    /// Whether the data determined the lag in use; a target of 0 may be an estimate near 0.
    fn is_measured(&self) -> bool {
        self.target_s != 0.0 || self.estimate().is_some_and(|skew| skew.is_precise())
    }

    /// Measured delay of the suit's stamps with the model's part, s; 0 without a measurement.
    pub(super) fn total_lag_s(&self) -> f64 {
        if self.is_measured() { self.applied_s + self.model_lag_s } else { 0.0 }
    }

    /// Skew and drift at the newest suit sample; `None` until two windows of motion agree.
    pub fn estimate(&self) -> Option<Skew> {
        self.estimator.at(self.time_ns)
    }

    /// The lag in use, s: the suit's sample stamped t belongs to the ground's stamped t − lag.
    pub fn lag_s(&self) -> f64 {
        self.applied_s
    }

    /// The lag in use, ns.
    pub(super) fn lag_ns(&self) -> i64 {
        (self.applied_s * 1e9) as i64
    }

    /// Whether the data contradict the lag in use: all values that depend on both streams are invalid.
    pub fn is_off(&self) -> bool {
        self.is_off == 1
    }

    /// 1-σ of the lag in use, s; 0 if none is in use. One without an estimate was stored, or has just been contradicted.
    pub(super) fn lag_sigma_s(&self) -> f64 {
        match self.estimate() {
            _ if self.target_s == 0.0 => 0.0,
            Some(Skew { skew_s, sigma_s, .. }) => math::hypot([skew_s - self.applied_s, sigma_s]),
            None => PRECISE_SIGMA_S,
        }
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.estimator.is_sound()
            && [self.target_s, self.applied_s].iter().all(|lag_s| lag_s.abs() < LAG_MAX_S)
            && self.model_lag_s.is_finite()
            && self.published_s.is_finite()
            && self.published_sigma_s.is_finite()
            && self.is_off <= 1
            && self.is_unknown <= 1
            && self.was_measured <= 1
    }
}

/// A lag that the alignment can correct, s; 0 for a larger one.
fn in_range(lag_s: f64) -> f64 {
    if lag_s.abs() < LAG_MAX_S { lag_s } else { 0.0 }
}

impl Skew {
    fn is_precise(&self) -> bool {
        self.sigma_s < PRECISE_SIGMA_S
    }
}

/// Consequence of a suit sample for the lag between the streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LagChange {
    /// The lag in use holds, or changes gradually.
    None,
    /// First and large lag of the session: all motion so far was aligned wrongly.
    First {
        /// Longer than the static pose window: a static body was paired with the ground samples of another pose.
        exceeds_window: bool,
    },
}

impl SkewMonitor {
    /// Ingests a suit sample of a subject, without the lag of the model, and updates the lag and the published skew.
    pub(super) fn update(
        &mut self,
        settings: &Settings,
        suit: &SuitSample,
        body: &Anthropometry,
        model_lag_s: f64,
    ) -> LagChange {
        self.model_lag_s = model_lag_s;
        let is_wanted = settings.align_streams && settings.motion != Motion::Paper;
        let is_first = self.ingest_suit(suit.sample_time_ns, height_m(suit, body), is_wanted);
        let sure = self.estimate().filter(Skew::is_precise);
        [self.published_s, self.published_sigma_s] =
            sure.map_or([0.0, 0.0], |skew| [skew.skew_s, skew.sigma_s]);
        if is_first {
            LagChange::First { exceeds_window: self.target_s.abs() > SPAN_NS as f64 * 1e-9 }
        } else {
            LagChange::None
        }
    }

    /// Skew and its 1-σ for publication, s: zero while the estimate is too uncertain.
    pub(super) fn published_s(&self) -> [f64; 2] {
        [self.published_s, self.published_sigma_s]
    }
}

/// Height of the CoM by the table's masses and centres, suit world, m.
fn height_m(suit: &SuitSample, body: &Anthropometry) -> f64 {
    (0..SEGMENTS)
        .map(|segment| {
            let ([w, x, y, z], [cx, cy, cz]) = (suit.orientation_wxyz[segment], body.com_m[segment]);
            let turned =
                2.0 * ((x * z - w * y) * cx + (y * z + w * x) * cy) + (1.0 - 2.0 * (x * x + y * y)) * cz;
            body.mass_fraction[segment] * (suit.position_m[segment][2] + turned)
        })
        .sum()
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::boxed::Box;

    use super::*;

    const MS_NS: u64 = 1_000_000;

    /// Test signal of an irregular vertical motion: height, m, and its second derivative, m/s².
    fn height(time_s: f64) -> [f64; 2] {
        let mut sum = [1.0, 0.0];
        for (amplitude_m, hertz) in [(0.10, 0.41), (0.05, 0.67), (0.02, 1.13)] {
            let omega = hertz * core::f64::consts::TAU;
            let offset_m = amplitude_m * (omega * time_s).sin();
            sum[0] += offset_m;
            sum[1] -= omega * omega * offset_m;
        }
        sum
    }

    /// One second of both streams; the suit's stamps are late by `late_ms(t)`.
    fn second(watch: &mut SkewMonitor, from_ms: u64, is_wanted: bool, late_ms: impl Fn(u64) -> i64) {
        for ms in from_ms..from_ms + 1000 {
            let time_s = ms as f64 * 1e-3;
            let force_n = [0.0, 0.0, 72.0 * (9.81 + height(time_s)[1])];
            let sample_time_ns = (10_000 + ms) * MS_NS;
            watch.ingest_ground(&GroundSample { sample_time_ns, force_n, ..Zeroable::zeroed() });
            if ms.is_multiple_of(10) {
                let before = watch.lag_s();
                let stamp_ns = sample_time_ns.saturating_add_signed(late_ms(ms) * MS_NS as i64);
                let step_s = stamp_ns.saturating_sub(watch.time_ns.max(1)) as f64 * 1e-9;
                watch.ingest_suit(stamp_ns, height(time_s)[0], is_wanted);
                assert!((watch.lag_s() - before).abs() <= SLEW * step_s + 1e-12, "a jump at {time_s} s");
            }
        }
        assert!(watch.is_sound());
    }

    #[test]
    fn a_large_lag_is_masked_until_it_is_corrected_and_again_after_a_change() {
        let mut watch: Box<SkewMonitor> = bytemuck::zeroed_box();
        let late_ms = |ms: u64| if ms < 60_000 { -138 } else { 162 };
        let mut was_off = [false; 2];
        for index in 0..120 {
            second(&mut watch, 1000 * index, true, late_ms);
            was_off[usize::from(index >= 60)] |= watch.is_off();
            if (20..60).contains(&index) {
                assert!(
                    !watch.is_off() && (watch.lag_s() + 0.138).abs() < 0.005,
                    "{index} s: {}",
                    watch.lag_s()
                );
            }
        }
        assert!(was_off[0] && was_off[1], "{was_off:?}");
        assert!(!watch.is_off() && (watch.lag_s() - 0.162).abs() < 0.005, "{}", watch.lag_s());
    }

    #[test]
    fn after_moved_stamps_the_lag_is_off_until_it_is_measured_again() {
        let mut watch: Box<SkewMonitor> = bytemuck::zeroed_box();
        for index in 0..30 {
            second(&mut watch, 1000 * index, true, |_| 20);
        }
        assert!(!watch.is_off());
        watch.compare_epochs([(1, 0), (2, 1)]);
        let mut measured_s = None;
        for index in 30..60 {
            second(&mut watch, 1000 * index, true, |_| 320);
            if !watch.is_off() {
                measured_s = measured_s.or(Some(index - 29));
                assert!((watch.lag_s() - 0.32).abs() < 0.01, "{index} s: {}", watch.lag_s());
            }
        }
        assert!(measured_s.is_some_and(|after_s| (5..12).contains(&after_s)), "{measured_s:?}");
    }

    /// Whether the first lag of a suit with this period exceeds the window; the suit's stamps are late by `late_ms`.
    fn first_lag_exceeds_window(period_ms: u64, late_ms: i64) -> bool {
        let mut watch: Box<SkewMonitor> = bytemuck::zeroed_box();
        let settings = Settings::for_height(1.7);
        let mut body: Anthropometry = Zeroable::zeroed();
        body.mass_fraction[0] = 1.0;
        let mut suit: SuitSample = Zeroable::zeroed();
        for ms in 0..30_000 {
            let time_s = ms as f64 * 1e-3;
            let force_n = [0.0, 0.0, 72.0 * (9.81 + height(time_s)[1])];
            let sample_time_ns = (10_000 + ms) * MS_NS;
            watch.ingest_ground(&GroundSample { sample_time_ns, force_n, ..Zeroable::zeroed() });
            if ms.is_multiple_of(period_ms) {
                suit.sample_time_ns = sample_time_ns.saturating_add_signed(late_ms * MS_NS as i64);
                (suit.orientation_wxyz[0][0], suit.position_m[0][2]) = (1.0, height(time_s)[0]);
                if let LagChange::First { exceeds_window } = watch.update(&settings, &suit, &body, 0.0) {
                    return exceeds_window;
                }
            }
        }
        panic!("no lag was found");
    }

    #[test]
    fn the_first_lag_is_compared_with_the_window_of_a_static_pose_at_every_rate() {
        assert!(first_lag_exceeds_window(33, -400), "30 Hz");
        assert!(!first_lag_exceeds_window(4, 150), "240 Hz");
    }

    #[test]
    fn a_measured_lag_remains_the_same_in_total_with_another_model() {
        let mut watch: Box<SkewMonitor> = bytemuck::zeroed_box();
        for index in 0..30 {
            second(&mut watch, 1000 * index, true, |_| 138);
        }
        for (model_ms, from) in [(138, 30), (0, 60)] {
            assert!(watch.replace_model_lag(1e-3 * model_ms as f64));
            for index in from..from + 30 {
                assert!((watch.total_lag_s() - 0.138).abs() < 0.005, "{index} s: {}", watch.total_lag_s());
                assert!(!watch.is_off() && watch.lag_sigma_s() > 0.0, "{index} s");
                second(&mut watch, 1000 * index, true, |_| 138 - model_ms);
            }
        }
        assert!((watch.lag_s() - 0.138).abs() < 0.005 && !watch.replace_model_lag(0.0));
        let mut unmeasured: Box<SkewMonitor> = bytemuck::zeroed_box();
        assert!(unmeasured.replace_model_lag(0.138) && unmeasured.lag_s() == 0.0);
        assert_eq!(unmeasured.total_lag_s(), 0.0);
    }

    #[test]
    fn at_rest_the_lag_follows_the_drift_and_its_sigma_grows() {
        let mut watch: Box<SkewMonitor> = bytemuck::zeroed_box();
        let late_ms = |ms: u64| -80 - ms as i64 / 1000;
        for index in 0..14 {
            second(&mut watch, 1000 * index, true, late_ms);
        }
        let moving_sigma_s = watch.lag_sigma_s();
        assert!(moving_sigma_s > 0.0 && watch.estimate().is_some_and(|skew| skew.is_precise()));
        for ms in 14_000..180_000_u64 {
            let sample_time_ns = (10_000 + ms) * MS_NS;
            watch.ingest_ground(&GroundSample {
                sample_time_ns,
                force_n: [0.0, 0.0, 706.0],
                ..Zeroable::zeroed()
            });
            if ms.is_multiple_of(10) {
                watch.ingest_suit(
                    sample_time_ns.saturating_add_signed(late_ms(ms) * MS_NS as i64),
                    1.0,
                    true,
                );
            }
        }
        let Some(Skew { skew_s, sigma_s, .. }) = watch.estimate() else { panic!("lost") };
        assert!(sigma_s > PRECISE_SIGMA_S, "{sigma_s}");
        assert!((watch.lag_s() - skew_s).abs() <= 2.0 * RESET_MIN_S, "{} {skew_s}", watch.lag_s());
        assert!(watch.lag_sigma_s() > moving_sigma_s);
        // The next morning the drift is an extrapolation by seconds.
        let before_s = watch.lag_s();
        let morning_ns = 15 * 3600 * 1_000_000_000;
        watch.ingest_suit(morning_ns, 1.0, true);
        assert!(watch.estimate().is_none_or(|skew| skew.sigma_s > CLOCK_SIGMA_MAX_S));
        assert!((watch.lag_s() - before_s).abs() < 2.0 * RESET_MIN_S && watch.is_sound());
    }

    #[test]
    fn without_the_correction_nothing_is_shifted_or_masked() {
        let mut watch: Box<SkewMonitor> = bytemuck::zeroed_box();
        for index in 0..30 {
            second(&mut watch, 1000 * index, false, |_| 80);
            assert!(!watch.is_off() && watch.lag_ns() == 0);
        }
        assert!(
            watch.estimate().is_some_and(|skew| (skew.skew_s - 0.08).abs() < 0.003),
            "estimated all the same"
        );
    }

    #[test]
    fn a_ground_sample_with_a_fault_is_not_ingested() {
        let mut watch: Box<SkewMonitor> = bytemuck::zeroed_box();
        let before = bytemuck::bytes_of(&*watch).to_vec();
        watch.ingest_ground(&GroundSample { sample_time_ns: 5, device_status: 1, ..Zeroable::zeroed() });
        assert_eq!(bytemuck::bytes_of(&*watch), before);
    }
}
