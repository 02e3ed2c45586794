//! Stage `test_lag`: sequential test of the lag in use against other lags, within some 0.3 s of a change of a stream's delay.
//!
//! [`super::skew_monitor`] estimates the lag over seconds. This test asks only whether the lag in use still explains
//! the vertical force, and needs mass and load. With the weight and inertia U of the unloaded body and the weight w per
//! kilogram in the hands, both by the suit, the mass in the hands under a lag τ is
//!
//! ```text
//! m_τ(t) = (F(t) − U(t − τ)) / w(t − τ)
//! ```
//!
//! τ is the delay of the ground relative to the lag in use. A suit that becomes later is left to the skew monitor: the
//! suit's later samples would be needed.
//!
//! Each sample has three explanations: the lag in use and an unchanged load, `N(m_0; μ, σ)`; another lag and an
//! unchanged load, `N(m_τ; μ, σ_τ)`; and a load that changes, uniform over ±25 kg. The log-likelihood ratio of each
//! other lag against the better of the remaining two, for the same force, is summed up from its last minimum (CUSUM;
//! Page 1954, Biometrika 41). So a load that is picked up is not a lag: no lag explains its force with the previous
//! load. Nor does a body at rest contradict a lag, and there no lag changes a result. If no lag explains a sample with
//! the previous load, the load has changed, and all sums restart.
//!
//! A rejected lag is accepted again when the sums of all others are below [`HINT`]. After a gap of the ground's samples all
//! others begin at [`EVIDENCE`]: no delay grows without a gap, for what arrived once does not arrive again.

use bytemuck::{Pod, Zeroable};

use super::differentiate::Instant;
use super::ground::Ground;
use super::identify::Identified;
use super::loading::Overload;
use super::prediction::Prediction;
use super::settings::{Motion, Settings};
use crate::GRAVITY_M_PER_S2;
use crate::math;

/// Alternative delays of the ground relative to the lag in use, s. Changes below half of the smallest are left to the
/// skew monitor.
const LATE_S: [f64; 4] = [0.1, 0.2, 0.3, 0.4];
/// Half of their spacing: a lag between two of them is off by up to this much, uniformly distributed, s.
const LATE_OFF_MAX_S: f64 = 0.05;
/// Range of a change of the load, kg: up to 25 kg, the reference mass of ISO 11228-1 for men, up or down.
const CHANGE_RANGE_KG: f64 = 50.0;
/// 1-σ of the mass in the hands beyond that of the force, kg: a load does not move exactly as the hands do. Chosen on
/// the sessions of `equipoise-study faults`, seeds 1 to 20: half of it rejects the right lag three times as often.
const LOAD_SIGMA_KG: f64 = 0.3;
/// Sum of log-likelihood ratios for a decision: odds of 150.
const EVIDENCE: f64 = 5.0;
/// From this sum on another lag is possible: the mean load holds. Within this of the best other lag, the lag in use
/// explains a sample equally well.
const HINT: f64 = 1.0;
/// Averaging time of the load, s: that of a detected load (`motion::unloaded`).
const MEAN_OVER_S: f64 = 1.0;
/// Duration of a new load before lags are compared, s: two windows of an acceleration.
const SETTLES_S: f64 = 0.28;
/// Stored samples, at intervals of at least `SPACING_NS`: the largest lag, and the samples on both sides of it.
const RING: usize = 36;
const SPACING_NS: u64 = 12_000_000;
/// Longer gaps of the suit restart the test; those of the ground set all sums to [`EVIDENCE`]: a delay that grows by the
/// smallest alternative makes one. Unit: ns.
const GAP_MAX_NS: u64 = 100_000_000;

/// Vertical force and the suit's prediction at one snapshot.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
struct Sample {
    time_ns: u64,
    /// Measured, N.
    force_n: f64,
    /// Of the unloaded body by the suit, N.
    unloaded_n: f64,
    /// Weight per kilogram in the hands, m/s².
    load_weight_m_per_s2: f64,
}

impl Sample {
    /// Mass in the hands by this force and the motion of another snapshot, kg.
    fn mass_kg(&self, suit: &Sample) -> f64 {
        (self.force_n - suit.unloaded_n) / suit.load_weight_m_per_s2
    }

    fn between(&self, later: &Sample, time_ns: u64) -> Sample {
        let span_ns = later.time_ns.saturating_sub(self.time_ns).max(1);
        let fraction = time_ns.saturating_sub(self.time_ns) as f64 / span_ns as f64;
        let mix = |from: f64, to: f64| from + fraction * (to - from);
        Sample {
            time_ns,
            force_n: mix(self.force_n, later.force_n),
            unloaded_n: mix(self.unloaded_n, later.unloaded_n),
            load_weight_m_per_s2: mix(self.load_weight_m_per_s2, later.load_weight_m_per_s2),
        }
    }
}

/// State of the test.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct LagTest {
    samples: [Sample; RING],
    /// Number of samples since the last gap.
    count: u64,
    /// Mean mass in the hands, kg, and its duration so far, s.
    load_kg: f64,
    load_s: f64,
    /// Sum of the log-likelihood ratios of each other lag.
    evidence: [f64; LATE_S.len()],
    /// 1 while another lag explains the force better than the lag in use, or may do so after a gap.
    rejected: u64,
    /// 1 if another lag changes the mass in the hands by more than its σ at the newest sample, or may do so.
    matters: u64,
}

/// Result of the test at one instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct LagVerdict {
    /// Whether the lag in use is rejected, and the results depend on it.
    pub(super) is_off: bool,
}

impl LagTest {
    fn verdict(&self) -> LagVerdict {
        LagVerdict { is_off: self.is_off() }
    }

    /// Whether the lag in use is rejected, and the results depend on it: not while the body is at rest.
    fn is_off(&self) -> bool {
        self.is_rejected() && self.matters == 1
    }

    fn is_rejected(&self) -> bool {
        self.rejected == 1
    }

    /// Ingests the longest interval between two ground samples in succession, ns.
    pub(super) fn ingest_ground_gap(&mut self, gap_ns: u64) {
        if gap_ns > GAP_MAX_NS {
            (self.rejected, self.evidence) = (1, [EVIDENCE; LATE_S.len()]);
        }
    }

    /// Starts again after a gap or unusable samples; the load and a rejection last until a sample contradicts them.
    fn restart(&mut self) {
        (self.count, self.matters) = (0, 1);
    }

    /// Starts again with another load.
    fn restart_load(&mut self, load_kg: f64) {
        (self.load_kg, self.load_s) = (load_kg, 0.0);
        if !self.is_rejected() {
            self.evidence = [0.0; LATE_S.len()];
        }
    }

    /// Accepts the lag in use and starts again.
    fn clear(&mut self) {
        self.rejected = 0;
        self.restart();
        self.restart_load(0.0);
    }

    fn newest(&self) -> Option<&Sample> {
        Some(&self.samples[self.count.checked_sub(1)? as usize % RING])
    }

    /// The sample at an earlier time; `None` before the oldest one.
    fn at(&self, time_ns: u64) -> Option<Sample> {
        let oldest = self.count.saturating_sub(RING as u64);
        let at = |index: u64| &self.samples[index as usize % RING];
        let mut later = self.count.checked_sub(1)?;
        while later > oldest && at(later - 1).time_ns > time_ns {
            later -= 1;
        }
        let earlier = later.checked_sub(1).filter(|index| *index >= oldest)?;
        (at(earlier).time_ns <= time_ns).then(|| at(earlier).between(at(later), time_ns))
    }

    /// Mass in the hands by the newest force if the ground is late, kg.
    fn mass_kg(&self, now: &Sample, late_s: f64) -> Option<f64> {
        Some(now.mass_kg(&self.at(now.time_ns.saturating_sub((late_s * 1e9) as u64))?))
    }

    /// Ingests a snapshot with the 1-σ of its external force, N, and the recent rate of the force, N/s. Samples within
    /// `window_s`, the window of an acceleration, count as one.
    fn update(&mut self, now: Sample, sigma_n: f64, rate_n_per_s: f64, window_s: f64) {
        let since_ns = self.newest().map(|newest| now.time_ns.saturating_sub(newest.time_ns));
        if since_ns.is_some_and(|since_ns| since_ns < SPACING_NS) {
            return;
        }
        if since_ns.is_some_and(|since_ns| since_ns > GAP_MAX_NS) {
            self.restart();
        }
        let step_s = if self.count == 0 { 0.0 } else { since_ns.unwrap_or(0) as f64 * 1e-9 };
        self.samples[self.count as usize % RING] = now;
        self.count += 1;
        let in_use_kg = now.mass_kg(&now);
        if self.load_s == 0.0 {
            self.load_kg = in_use_kg;
        }
        let sigma_kg = math::hypot([sigma_n / now.load_weight_m_per_s2, LOAD_SIGMA_KG]);
        let by_lag_kg = LATE_OFF_MAX_S / math::sqrt(3.0) * rate_n_per_s / GRAVITY_M_PER_S2;
        let other_sigma_kg = math::hypot([sigma_kg, by_lag_kg]);
        let changed = -math::ln(CHANGE_RANGE_KG);
        let in_use = log_likelihood(in_use_kg, sigma_kg, self.load_kg);
        let (mut best, mut best_kg) = (f64::NEG_INFINITY, in_use_kg);
        self.matters = 0;
        let others = LATE_S.map(|late_s| {
            let mass_kg = self.mass_kg(&now, late_s);
            self.matters |= u64::from(mass_kg.is_none_or(|mass_kg| (mass_kg - in_use_kg).abs() > sigma_kg));
            let other = log_likelihood(mass_kg?, other_sigma_kg, self.load_kg);
            if other > best {
                (best, best_kg) = (other, mass_kg?);
            }
            Some(other)
        });
        let weight = step_s / window_s;
        let unknown = if self.is_rejected() { 0.0 } else { -HINT };
        if self.load_s >= SETTLES_S {
            for (evidence, other) in self.evidence.iter_mut().zip(others) {
                let ratio = other.map_or(unknown, |other| other - in_use.max(changed));
                *evidence = (*evidence + weight * ratio).clamp(0.0, 2.0 * EVIDENCE);
            }
        }
        let most = self.evidence.iter().copied().fold(0.0, f64::max);
        let is_compared = !self.is_rejected() || others.iter().all(Option::is_some);
        if in_use.max(best) < changed && is_compared {
            self.restart_load(in_use_kg);
        } else if self.is_rejected() && best > in_use {
            self.load_kg += (best_kg - self.load_kg) * (step_s / MEAN_OVER_S).min(1.0);
        } else if in_use > changed && (self.is_rejected() || most <= HINT) {
            self.load_s = (self.load_s + step_s).min(MEAN_OVER_S);
            self.load_kg += (in_use_kg - self.load_kg) * (step_s / self.load_s.max(1e-9)).min(1.0);
        }
        self.rejected = u64::from(most > if self.is_rejected() { HINT } else { EVIDENCE });
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub(super) fn is_sound(&self) -> bool {
        let numbers = |sample: &Sample| [sample.force_n, sample.unloaded_n, sample.load_weight_m_per_s2];
        self.samples.iter().flat_map(numbers).all(f64::is_finite)
            && self.count < 1 << 48
            && self.load_kg.is_finite()
            && (0.0..=MEAN_OVER_S).contains(&self.load_s)
            && self.evidence.iter().all(|sum| sum.is_finite() && *sum >= 0.0)
            && self.rejected <= 1
            && self.matters <= 1
    }
}

/// Logarithm of the normal density of a mass with this σ about the load, 1/kg.
fn log_likelihood(mass_kg: f64, sigma_kg: f64, load_kg: f64) -> f64 {
    let deviation = (mass_kg - load_kg) / sigma_kg;
    -0.5 * deviation * deviation - math::ln(math::sqrt(core::f64::consts::TAU) * sigma_kg)
}

/// Stage `test_lag`: ingests the external force of an instant.
pub(super) fn test_lag(
    settings: &Settings,
    state: &mut LagTest,
    instant: &Instant,
    ground: &Ground,
    prediction: &Prediction,
    overload: Option<&Overload>,
    subject: Identified<'_>,
) -> LagVerdict {
    let is_wanted = settings.align_streams && settings.motion != Motion::Paper;
    if !is_wanted || subject.identified != 1 || subject.mass_kg <= 0.0 || !subject.has_body() {
        state.clear();
        return state.verdict();
    }
    let force_n = instant.snapshot.ground.force_n[2];
    let Some(overload) = overload
        .filter(|overload| prediction.is_measured && force_n.is_finite() && overload.delta_f_n.is_finite())
    else {
        state.restart();
        return state.verdict();
    };
    let now = Sample {
        time_ns: instant.snapshot.time_ns,
        force_n,
        unloaded_n: force_n - overload.delta_f_n,
        load_weight_m_per_s2: prediction.body.load_weight_m_per_s2(),
    };
    let window_s = 2.0 * settings.half_window_ns() as f64 * 1e-9;
    state.update(now, overload.delta_f_sigma_n, ground.rate_n_per_s, window_s.max(1e-3));
    state.verdict()
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    const WINDOW_S: f64 = 0.14;
    const MASS_KG: f64 = 72.0;

    /// Vertical acceleration of squats and bends, m/s².
    fn acceleration_m_per_s2(time_s: f64) -> f64 {
        1.2 * (2.7 * time_s).sin() + 0.5 * (4.1 * time_s + 1.0).sin()
    }

    /// Works for this time at 60 Hz; the force comes `late_s(t)` late. Returns the time of each rejection, and the part
    /// of the samples that are rejected.
    fn work(
        seconds: f64,
        motion: f64,
        late_s: impl Fn(f64) -> f64,
        load_kg: impl Fn(f64) -> f64,
    ) -> (Option<f64>, f64) {
        let mut test = LagTest::zeroed();
        let (mut first_s, mut rejected, count) = (None, 0.0, (60.0 * seconds) as u32);
        for index in 0..count {
            let time_s = f64::from(index) / 60.0;
            let specific = |time_s: f64| GRAVITY_M_PER_S2 + motion * acceleration_m_per_s2(time_s);
            let noise_n = if index % 2 == 0 { 1.5 } else { -1.5 };
            let at_s = time_s - late_s(time_s);
            let now = Sample {
                time_ns: 1_000_000_000 + (time_s * 1e9) as u64,
                force_n: (MASS_KG + load_kg(at_s)) * specific(at_s) + noise_n,
                unloaded_n: MASS_KG * specific(time_s),
                load_weight_m_per_s2: specific(time_s),
            };
            test.update(now, 2.5, 100.0 * motion, WINDOW_S);
            assert!(test.is_sound());
            if test.is_off() {
                first_s = first_s.or(Some(time_s));
                rejected += 1.0 / f64::from(count);
            }
        }
        (first_s, rejected)
    }

    #[test]
    fn a_change_of_the_delay_is_detected_within_half_a_second_of_motion_and_its_end_within_one() {
        for late_s in [0.15, 0.3, 0.4] {
            for begins_s in [5.0, 5.4, 5.9, 6.3] {
                let late =
                    |time_s: f64| if (begins_s..begins_s + 5.0).contains(&time_s) { late_s } else { 0.0 };
                let (first_s, rejected) = work(20.0, 1.0, late, |_| 11.0);
                let after_s = first_s.unwrap_or(f64::INFINITY) - begins_s;
                assert!((0.0..0.6).contains(&after_s), "{late_s} s from {begins_s} s: after {after_s} s");
                assert!(rejected < 7.0 / 20.0, "{late_s} s from {begins_s} s: {rejected}");
            }
        }
    }

    #[test]
    fn a_load_that_is_picked_up_or_put_down_is_rarely_a_lag_and_for_less_than_two_seconds() {
        let mut rejections = 0;
        for over_s in [0.1, 0.3, 0.6, 1.0] {
            for phase in 0..40 {
                let begins_s = 4.0 + 0.1 * f64::from(phase);
                let part = |time_s: f64| ((time_s - begins_s) / over_s).clamp(0.0, 1.0);
                let load_kg = |time_s: f64| 15.0 * (part(time_s) - part(time_s - 5.0));
                let (first_s, rejected) = work(15.0, 1.0, |_| 0.0, load_kg);
                rejections += u32::from(first_s.is_some());
                assert!(rejected < 2.0 / 15.0, "{over_s} s from {begins_s} s: {rejected}");
            }
        }
        assert!(rejections <= 10, "{rejections} of 320 changes of the load");
    }

    #[test]
    fn after_a_gap_of_the_ground_the_lag_is_rejected_until_the_data_exclude_all_others() {
        let mut test = LagTest::zeroed();
        let mut accepted_s = None;
        for index in 0..600_u32 {
            let time_s = f64::from(index) / 60.0;
            let specific = GRAVITY_M_PER_S2 + acceleration_m_per_s2(time_s);
            let now = Sample {
                time_ns: 1_000_000_000 + (time_s * 1e9) as u64,
                force_n: (MASS_KG + 11.0) * specific,
                unloaded_n: MASS_KG * specific,
                load_weight_m_per_s2: specific,
            };
            if index == 300 {
                assert!(!test.is_rejected());
                test.ingest_ground_gap(GAP_MAX_NS);
                assert!(!test.is_rejected(), "an ordinary interval");
                test.ingest_ground_gap(GAP_MAX_NS + 1);
                assert!(test.is_rejected());
            }
            test.update(now, 2.5, 100.0, WINDOW_S);
            if index >= 300 && !test.is_rejected() {
                accepted_s = accepted_s.or(Some(time_s - 5.0));
            }
        }
        let accepted_s = accepted_s.expect("accepted again");
        assert!((0.1..2.0).contains(&accepted_s), "after {accepted_s} s");
    }

    #[test]
    fn a_body_at_rest_contradicts_no_lag() {
        let late = |time_s: f64| if time_s > 5.0 { 0.3 } else { 0.0 };
        assert_eq!(work(20.0, 0.0, late, |_| 11.0).0, None);
    }
}
