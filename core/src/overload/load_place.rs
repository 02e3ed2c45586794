//! Position of a load in the hands: the hand load fraction η, and its distance ahead of the line between the grips.
//!
//! The two CoPs give the load's position at every instant, `p = (C_wt (W + ΔF) − Ĉ_wo W)/ΔF`, with an error of σ_CoP
//! W/ΔF that lasts as long as the posture, because it results from the body model. The position in the hands is
//! constant during a carry. So each coordinate is a mean over the carry with the weights `w = dt/σ²`. For an error with
//! the correlation time τ the mean has the variance `(T/Σw)/(1 + T/2τ)`, T being the time that the weights cover,
//! `(Σw)²/Σ(w²/dt)`: that of one instant at first, `2τ/Σw` in the end. It is combined with a prior.

use bytemuck::{Pod, Zeroable};

use crate::math;

/// 1-σ of the hand load fraction between people, around equal shares.
const EVEN_SIGMA: f64 = 0.2;
/// Prior mean and 1-σ of the distance of a load's centre ahead of the grips, m: between 0 for a handle and 50 mm for
/// the centre of a box; the variance of a uniform distribution is the square of its width over 12.
const AHEAD_M: f64 = 0.025;
const AHEAD_SIGMA_M: f64 = 0.0144;
/// Correlation time of the CoPs' errors: from one posture of work to the next, s.
const POSTURE_S: f64 = 2.0;
/// Averaging time, because grips change, s: older measurements have less weight.
const GRIP_S: f64 = 15.0;
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

/// Sums over a carry: w, w z, and w²/dt.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Coordinate {
    weight: f64,
    weighted: f64,
    square: f64,
}

impl Coordinate {
    fn update(&mut self, measured: Measured, step_s: f64) {
        let variance = measured.sigma * measured.sigma;
        // False for NaN.
        if !(variance > 0.0 && variance < f64::MAX && measured.value.abs() < f64::MAX && step_s > 0.0) {
            return;
        }
        if self.weight > 0.0 {
            let [mean, own_variance] = self.mean();
            let off = measured.value - mean;
            if off * off > ANOTHER_GRIP_SIGMAS * ANOTHER_GRIP_SIGMAS * (variance + own_variance) {
                *self = Zeroable::zeroed();
            }
        }
        let (kept, weight) = (1.0 / (1.0 + step_s / GRIP_S), step_s / variance);
        self.weight = kept * self.weight + weight;
        self.weighted = kept * self.weighted + weight * measured.value;
        self.square = kept * self.square + weight * weight / step_s;
    }

    /// Mean and variance of the mean, without a prior.
    fn mean(&self) -> [f64; 2] {
        let covered_s = self.weight * self.weight / self.square;
        let variance = covered_s / self.weight / (1.0 + covered_s / (2.0 * POSTURE_S));
        [self.weighted / self.weight, variance]
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
        self.weighted.is_finite()
            && [self.weight, self.square].iter().all(|sum| sum.is_finite() && *sum >= 0.0)
    }
}

/// Estimate of the load's position in the hands during one carry.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct LoadPlace {
    right: Coordinate,
    ahead: Coordinate,
}

impl LoadPlace {
    /// Resets the estimate: no load is carried.
    pub fn reset(&mut self) {
        *self = Zeroable::zeroed();
    }

    /// Ingests the position by the CoPs, `step_s` after the previous instant: η of the right hand (`None` for hands
    /// close together), and the distance of the load ahead of the line between the grips, m.
    pub fn update(&mut self, right: Option<Measured>, ahead_m: Measured, step_s: f64) {
        if let Some(right) = right {
            self.right.update(right, step_s);
        }
        self.ahead.update(ahead_m, step_s);
    }

    /// η: hand load fractions, left and right; equal before a load is carried.
    pub fn eta(&self) -> [f64; 2] {
        let [right, _] = self.right.posterior(0.5, EVEN_SIGMA);
        let right = right.clamp(0.0, 1.0);
        [1.0 - right, right]
    }

    /// 1-σ of η.
    pub fn eta_sigma(&self) -> f64 {
        math::sqrt(self.right.posterior(0.5, EVEN_SIGMA)[1])
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

    fn carry(seconds: f64, error: impl Fn(f64) -> f64, sigma: f64) -> LoadPlace {
        let mut place = LoadPlace::zeroed();
        for step in 0..(seconds * 60.0) as u32 {
            let time_s = f64::from(step) / 60.0;
            let right = Measured { value: 0.7 + error(time_s), sigma };
            let ahead = Measured { value: 0.04, sigma: 0.5 };
            place.update(Some(right), ahead, 1.0 / 60.0);
        }
        place
    }

    #[test]
    fn a_long_carry_in_many_postures_says_more_than_a_short_one() {
        // An error that changes every two seconds, as large as its σ.
        let error = |time_s: f64| if ((time_s * 0.5) as u32).is_multiple_of(2) { 0.3 } else { -0.3 };
        let (short, long) = (carry(0.5, error, 0.3), carry(30.0, error, 0.3));
        assert!(long.eta_sigma() < 0.8 * short.eta_sigma(), "{} {}", long.eta_sigma(), short.eta_sigma());
        assert!((long.eta()[1] - 0.7).abs() < 2.0 * long.eta_sigma(), "{:?}", long.eta());
        assert!(long.is_sound() && short.is_sound());
    }

    #[test]
    fn a_precise_instant_says_where_the_load_is_and_a_vague_one_leaves_the_prior() {
        let precise = carry(0.1, |_| 0.0, 0.01);
        assert!((precise.eta()[1] - 0.7).abs() < 0.01 && precise.eta_sigma() < 0.02);
        let vague = carry(0.1, |_| 0.0, 10.0);
        assert!((vague.eta()[1] - 0.5).abs() < 0.01 && (vague.eta_sigma() - EVEN_SIGMA).abs() < 0.01);
        let [ahead_m, sigma_m] = vague.ahead_m();
        assert!(
            (ahead_m - AHEAD_M).abs() < 0.005 && (sigma_m - AHEAD_SIGMA_M).abs() < 0.005,
            "{ahead_m} {sigma_m}"
        );
    }

    #[test]
    fn a_load_that_goes_to_the_other_hand_is_followed() {
        let mut place = carry(20.0, |_| 0.0, 0.05);
        for _ in 0..30 {
            place.update(
                Some(Measured { value: 0.0, sigma: 0.05 }),
                Measured { value: 0.04, sigma: 0.5 },
                1.0 / 60.0,
            );
        }
        assert!(place.eta()[1] < 0.1, "{:?}", place.eta());
    }

    #[test]
    fn what_is_not_a_number_changes_nothing_and_a_reset_is_the_start() {
        let mut place = carry(1.0, |_| 0.0, 0.1);
        let before = place.eta();
        for value in [f64::NAN, f64::INFINITY] {
            place.update(
                Some(Measured { value, sigma: 0.1 }),
                Measured { value: 0.0, sigma: f64::NAN },
                1.0 / 60.0,
            );
        }
        assert_eq!(place.eta(), before);
        place.reset();
        assert_eq!((place.eta(), place.ahead_m()), ([0.5; 2], [AHEAD_M, AHEAD_SIGMA_M]));
    }
}
