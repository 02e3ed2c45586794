//! Position of a load in the hands: the hand load fraction η, and its distance ahead of the line between the grips.
//!
//! The two CoPs give the load's position at every instant, `p = (C_wt (W + ΔF) − Ĉ_wo W)/ΔF`. The position in the hands
//! is constant during a carry. So each coordinate is a mean over the carry with the weights `w = dt/σ²`, combined with
//! a prior. Its error has two parts:
//!
//! - that of the body model, `h δθ` with the row `h` of Ĉ_wo times W/ΔF. θ's error is the same in every posture, so the
//!   mean has the variance `h̄ P h̄ᵀ` with the weighted mean `h̄` of the rows;
//! - the rest, which lasts as long as the posture. For an error with the correlation time τ the mean has the variance
//!   `v̄/(1 + T/2τ)`, v̄ being the weighted mean of its variance and T the time that the weights cover,
//!   `(Σw)²/Σ(w²/dt)`: that of one instant at first, `2τ v̄/T` in the end.

use bytemuck::{Pod, Zeroable};

use crate::kalman::STATES;
use crate::math;

/// Prior mean of the hand load fraction …
pub const EVEN: f64 = 0.5;
/// … and its 1-σ: uniform between one hand and the other.
pub const EVEN_SIGMA: f64 = 0.289;
/// Prior mean of the distance of a load's centre ahead of the grips, m: between 0 for a handle and 50 mm for the centre
/// of a box …
pub const AHEAD_M: f64 = 0.025;
/// … and its 1-σ: the variance of a uniform distribution is the square of its width over 12.
pub const AHEAD_SIGMA_M: f64 = 0.0144;
/// 1-σ of the point of action on the hand, in addition to the uncertainty ahead, m, each of a uniform distribution.
/// Across the hand: the middle third of its breadth at the knuckles, 84 mm. Along it: from the hollow of the palm to
/// the middle of the first phalanges, 42 mm. Normal to the palm: the middle of handles and edges 10 to 50 mm thick.
pub const GRIP_SIGMA_M: [f64; 3] = [0.0081, 0.0121, 0.0058];
/// Correlation time of the CoPs' errors besides the body model's: from one posture of work to the next, s.
const POSTURE_S: f64 = 2.0;
/// Averaging time, because grips change, s: older measurements have less weight.
const GRIP_S: f64 = 15.0;
/// Longest time that one measurement represents, s: 1.5 periods of the slowest suit, 15 Hz.
const STEP_MAX_S: f64 = 0.1;
/// A position this many σ from the mean is another grip: the mean restarts.
pub const ANOTHER_GRIP_SIGMAS: f64 = 3.0;

/// One coordinate as computed from the CoPs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The value.
    pub value: f64,
    /// Its 1-σ.
    pub sigma: f64,
}

impl Measured {
    /// Whether a difference is larger than `sigmas` σ.
    pub fn is_beyond(&self, sigmas: f64) -> bool {
        self.value.abs() > sigmas * self.sigma
    }
}

/// One coordinate with the body model's part of its error separate.
#[derive(Debug, Clone, Copy)]
pub struct ByModel {
    /// The value, and the 1-σ of its error besides the body model's part.
    pub measured: Measured,
    /// Row that gives the body model's part of the error from θ's.
    pub row: [f64; STATES],
}

/// Sums over a carry.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Coordinate {
    /// Σ w.
    weight: f64,
    /// Σ w z.
    weighted: f64,
    /// Σ w²/dt.
    square: f64,
    /// Σ w v: v is the variance of a value besides the body model's part.
    rest: f64,
    /// `h̄`.
    row: [f64; STATES],
    /// `h̄ P h̄ᵀ`.
    by_model: f64,
}

impl Coordinate {
    /// Ingests one value; `times_covariance` gives `P hᵀ`.
    fn update(
        &mut self,
        value: &ByModel,
        step_s: f64,
        times_covariance: impl Fn(&[f64; STATES]) -> [f64; STATES],
    ) {
        // One measurement after a gap must not have the weight of the gap.
        let step_s = step_s.min(STEP_MAX_S);
        let ByModel { measured, row } = value;
        let rest = measured.sigma * measured.sigma;
        let spread = times_covariance(row);
        let dot =
            |row: &[f64; STATES]| row.iter().zip(&spread).map(|(row, spread)| row * spread).sum::<f64>();
        let (own, with_mean) = (dot(row).max(0.0), dot(&self.row));
        let variance = rest + own;
        // False for NaN.
        if !(variance > 0.0
            && variance < f64::MAX
            && measured.value.abs() < f64::MAX
            && row.iter().all(|part| part.is_finite())
            && step_s > 0.0)
        {
            return;
        }
        if self.weight > 0.0 {
            let off = measured.value - self.weighted / self.weight;
            let apart = (own - 2.0 * with_mean + self.by_model).max(0.0);
            let off_variance = apart + rest + self.rest_variance();
            if off * off > ANOTHER_GRIP_SIGMAS * ANOTHER_GRIP_SIGMAS * off_variance {
                *self = Zeroable::zeroed();
            }
        }
        let (kept, weight) = ((1.0 - step_s / GRIP_S).max(0.0), step_s / variance);
        self.weight = kept * self.weight + weight;
        self.weighted = kept * self.weighted + weight * measured.value;
        self.square = kept * self.square + weight * weight / step_s;
        self.rest = kept * self.rest + weight * rest;
        let gain = weight / self.weight;
        for (mean, own) in self.row.iter_mut().zip(row) {
            *mean += gain * (own - *mean);
        }
        // By recursion, because a product with P is most of a step's cost: θ is not updated while a load is carried.
        let retained = 1.0 - gain;
        self.by_model =
            retained * retained * self.by_model + 2.0 * retained * gain * with_mean + gain * gain * own;
        self.by_model = self.by_model.max(0.0);
    }

    /// Variance of the mean besides the body model's part.
    fn rest_variance(&self) -> f64 {
        let covered_s = self.weight * self.weight / self.square;
        self.rest / self.weight / (1.0 + covered_s / (2.0 * POSTURE_S))
    }

    /// Mean and variance of the mean, without a prior.
    fn mean(&self) -> [f64; 2] {
        [self.weighted / self.weight, self.by_model + self.rest_variance()]
    }

    /// Mean and variance, with a prior of this mean and 1-σ.
    fn posterior(&self, prior: f64, prior_sigma: f64) -> [f64; 2] {
        let prior_variance = prior_sigma * prior_sigma;
        if self.weight <= 0.0 {
            return [prior, prior_variance];
        }
        let [mean, variance] = self.mean();
        let gain = prior_variance / (prior_variance + variance);
        [prior + gain * (mean - prior), gain * variance]
    }

    fn is_sound(&self) -> bool {
        let sums = [self.weight, self.square, self.rest, self.by_model];
        self.weighted.is_finite()
            && self.row.iter().all(|value| value.is_finite())
            && sums.iter().all(|sum| sum.is_finite() && *sum >= 0.0)
    }
}

/// Estimate of the load's position in the hands during one carry.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct LoadPosition {
    right: Coordinate,
    ahead: Coordinate,
}

impl LoadPosition {
    /// Resets the estimate: no load is carried.
    pub fn reset(&mut self) {
        *self = Zeroable::zeroed();
    }

    /// Ingests the position by the CoPs, `step_s` after the previous instant: η of the right hand (`None` for hands
    /// close together), and the distance of the load ahead of the line between the grips, m. `times_covariance`
    /// gives `P hᵀ` of the body model.
    pub fn update(
        &mut self,
        right: Option<&ByModel>,
        ahead_m: &ByModel,
        step_s: f64,
        times_covariance: impl Fn(&[f64; STATES]) -> [f64; STATES],
    ) {
        if let Some(right) = right {
            self.right.update(right, step_s, &times_covariance);
        }
        self.ahead.update(ahead_m, step_s, &times_covariance);
    }

    /// η: hand load fractions, left and right; equal before a load is carried.
    pub fn eta(&self) -> [f64; 2] {
        let [right, _] = self.right.posterior(EVEN, EVEN_SIGMA);
        let right = right.clamp(0.0, 1.0);
        [1.0 - right, right]
    }

    /// 1-σ of η.
    pub fn eta_sigma(&self) -> f64 {
        math::sqrt(self.right.posterior(EVEN, EVEN_SIGMA)[1])
    }

    /// Distance of the load ahead of the line between the grips, and its 1-σ, m.
    pub fn ahead_m(&self) -> [f64; 2] {
        let [ahead_m, variance_m2] = self.ahead.posterior(AHEAD_M, AHEAD_SIGMA_M);
        [ahead_m, math::sqrt(variance_m2)]
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.right.is_sound() && self.ahead.is_sound()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// θ with unit variance in its first state.
    fn first_state(row: &[f64; STATES]) -> [f64; STATES] {
        let mut spread = [0.0; STATES];
        spread[0] = row[0];
        spread
    }

    /// A value of whose variance this share is the body model's, with this sign.
    fn by_model(value: f64, sigma: f64, fraction: f64) -> ByModel {
        let mut row = [0.0; STATES];
        row[0] = fraction.signum() * sigma * fraction.abs().sqrt();
        ByModel { measured: Measured { value, sigma: sigma * (1.0 - fraction.abs()).sqrt() }, row }
    }

    fn after_carry(seconds: f64, error: impl Fn(f64) -> f64, sigma: f64) -> LoadPosition {
        let mut position = LoadPosition::zeroed();
        for step in 0..(seconds * 60.0) as u32 {
            let time_s = f64::from(step) / 60.0;
            let right = by_model(0.7 + error(time_s), sigma, 0.0);
            position.update(Some(&right), &by_model(0.04, 0.5, 0.0), 1.0 / 60.0, first_state);
        }
        position
    }

    #[test]
    fn a_long_carry_in_many_postures_lowers_sigma_more_than_a_short_one() {
        // An error that changes every two seconds, as large as its σ.
        let error = |time_s: f64| if ((time_s * 0.5) as u32).is_multiple_of(2) { 0.3 } else { -0.3 };
        let (short, long) = (after_carry(0.5, error, 0.3), after_carry(30.0, error, 0.3));
        assert!(long.eta_sigma() < 0.8 * short.eta_sigma(), "{} {}", long.eta_sigma(), short.eta_sigma());
        assert!((long.eta()[1] - 0.7).abs() < 2.0 * long.eta_sigma(), "{:?}", long.eta());
        assert!(long.is_sound() && short.is_sound());
    }

    #[test]
    fn one_instant_after_a_gap_weighs_no_more_than_a_tenth_of_a_second() {
        let after = |gap_s: Option<f64>| {
            let mut position = LoadPosition::zeroed();
            let mut update = |eta: f64, step_s: f64| {
                let right = by_model(eta, 0.2, 0.0);
                position.update(Some(&right), &by_model(0.04, 0.5, 0.0), step_s, first_state);
            };
            if let Some(gap_s) = gap_s {
                update(0.5, gap_s);
            }
            (0..120).for_each(|_| update(0.7, 1.0 / 60.0));
            position.eta()[1]
        };
        let (with, without) = (after(Some(10.0)), after(None));
        assert!((with - without).abs() < 0.02, "{with} {without}");
    }

    #[test]
    fn the_error_of_the_body_model_averages_out_only_over_varied_postures() {
        let sigma_after_30_s = |fraction_at: fn(u32) -> f64| {
            let mut position = LoadPosition::zeroed();
            for step in 0..1800 {
                let right = by_model(0.7, 0.05, fraction_at(step));
                position.update(Some(&right), &by_model(0.04, 0.5, 0.0), 1.0 / 60.0, first_state);
            }
            position.eta_sigma()
        };
        let one_posture = sigma_after_30_s(|_| 1.0);
        assert!((one_posture - 0.0493).abs() < 1e-3, "0.05 and the prior's 0.289 together: {one_posture}");
        let both_ways = sigma_after_30_s(|step| if step % 2 == 0 { 1.0 } else { -1.0 });
        assert!(both_ways < 0.005, "{both_ways}");
        assert!(sigma_after_30_s(|_| 0.0) < 0.5 * one_posture);
    }

    #[test]
    fn a_precise_measurement_moves_the_estimate_and_a_vague_one_keeps_the_prior() {
        let precise = after_carry(0.1, |_| 0.0, 0.01);
        assert!((precise.eta()[1] - 0.7).abs() < 0.01 && precise.eta_sigma() < 0.02);
        let vague = after_carry(0.1, |_| 0.0, 10.0);
        assert!((vague.eta()[1] - 0.5).abs() < 0.01 && (vague.eta_sigma() - EVEN_SIGMA).abs() < 0.01);
        let [ahead_m, sigma_m] = vague.ahead_m();
        assert!(
            (ahead_m - AHEAD_M).abs() < 0.005 && (sigma_m - AHEAD_SIGMA_M).abs() < 0.005,
            "{ahead_m} {sigma_m}"
        );
    }

    #[test]
    fn a_load_that_changes_hands_is_tracked() {
        let mut position = after_carry(20.0, |_| 0.0, 0.05);
        for _ in 0..30 {
            position.update(
                Some(&by_model(0.0, 0.05, 0.0)),
                &by_model(0.04, 0.5, 0.0),
                1.0 / 60.0,
                first_state,
            );
        }
        assert!(position.eta()[1] < 0.1, "{:?}", position.eta());
    }

    #[test]
    fn non_finite_values_change_nothing_and_a_reset_restores_the_start() {
        let mut position = after_carry(1.0, |_| 0.0, 0.1);
        let before = position.eta();
        for value in [f64::NAN, f64::INFINITY] {
            position.update(
                Some(&by_model(value, 0.1, 0.5)),
                &by_model(0.0, f64::NAN, 0.5),
                1.0 / 60.0,
                first_state,
            );
        }
        assert_eq!(position.eta(), before);
        position.reset();
        assert_eq!((position.eta(), position.ahead_m()), ([0.5; 2], [AHEAD_M, AHEAD_SIGMA_M]));
    }
}
