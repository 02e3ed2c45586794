//! Variance of the difference between two estimates, as a function of how fast the body moves.

use bytemuck::{Pod, Zeroable};

/// Differences are forgotten with this time constant, s: the pace of work changes within minutes.
const KEPT_S: f64 = 60.0;
/// Weight of the prior, s of data: one natural lift.
const PRIOR_S: f64 = 2.0;
/// A difference counts as at most this many σ: one pick-up would otherwise last for a minute.
const SIGMAS_MAX: f64 = 5.0;
/// Motion intensity at which both terms of the variance have the same weight, m/s²: half of the body's typical
/// acceleration in natural work.
const INTENSITY_M_PER_S2: f64 = 0.5;

/// Variance at rest, and its increase at `INTENSITY_M_PER_S2`, in the square of the quantity's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VariancePrior {
    /// Variance of a body at rest, in the square of the quantity's unit.
    pub at_rest: f64,
    /// Increase at `INTENSITY_M_PER_S2`.
    pub by_motion: f64,
}

/// Regression `d² = a + b I²` of the squared difference d on the motion intensity I, m/s². Least squares with the weights
/// `1/(c + I²)²`, which make the relative errors equal: with `p = c/(c + I²)` and `q = 1 − p`, `y = c d²/(c + I²)` is
/// `a p + b c q`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct DifferenceVariance {
    /// Sums over time of pp, pq, qq, py and qy, s.
    sums: [f64; 5],
}

impl DifferenceVariance {
    /// Ingests a difference at a motion intensity, `step_s` after the previous one.
    pub fn update(&mut self, difference: f64, intensity: f64, step_s: f64, prior: &VariancePrior) {
        if !(difference.is_finite() && intensity.is_finite()) {
            return;
        }
        let limit = SIGMAS_MAX * SIGMAS_MAX * self.variance(intensity, prior);
        let square = (difference * difference).min(limit);
        let step_s = step_s.clamp(0.0, 1.0);
        let [p, q] = weights(intensity);
        let y = p * square;
        let kept = 1.0 / (1.0 + step_s / KEPT_S);
        for (sum, value) in self.sums.iter_mut().zip([p * p, p * q, q * q, p * y, q * y]) {
            *sum = kept * *sum + step_s * value;
        }
    }

    /// Variance of the difference at a motion intensity.
    pub fn variance(&self, intensity: f64, prior: &VariancePrior) -> f64 {
        let [pp, pq, qq, py, qy] = self.sums;
        let (pp, qq) = (pp + PRIOR_S, qq + PRIOR_S);
        let (py, qy) = (py + PRIOR_S * prior.at_rest, qy + PRIOR_S * prior.by_motion);
        let determinant = pp * qq - pq * pq;
        let [rest, motion] = [(py * qq - qy * pq) / determinant, (qy * pp - py * pq) / determinant];
        // Neither term is negative: without one of them, the other explains the data alone.
        let [rest, motion] = match (rest < 0.0, motion < 0.0) {
            (true, _) => [0.0, qy / qq],
            (_, true) => [py / pp, 0.0],
            _ => [rest, motion],
        };
        let [p, q] = weights(intensity);
        rest + motion * q / p
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.sums.iter().all(|sum| (0.0..1e12).contains(sum))
    }
}

/// Weights p and q of the variance at rest and by motion, at an intensity, m/s².
fn weights(intensity: f64) -> [f64; 2] {
    let reference = INTENSITY_M_PER_S2 * INTENSITY_M_PER_S2;
    // Limited so that p remains positive.
    let square = (intensity * intensity).min(1e4 * reference);
    let p = reference / (reference + square);
    [p, 1.0 - p]
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRIOR: VariancePrior = VariancePrior { at_rest: 1.0, by_motion: 1.0 };

    #[test]
    fn variance_at_rest_and_by_motion_are_estimated() {
        let mut variance = DifferenceVariance::zeroed();
        assert_eq!(variance.variance(0.0, &PRIOR), 1.0);
        assert!((variance.variance(INTENSITY_M_PER_S2, &PRIOR) - 2.0).abs() < 1e-12);
        for index in 0..6000 {
            let intensity = 0.2 * f64::from(index % 11);
            let sigma = (4.0 + 9.0 * intensity * intensity).sqrt();
            variance.update(if index % 2 == 0 { sigma } else { -sigma }, intensity, 0.01, &PRIOR);
        }
        assert!((variance.variance(0.0, &PRIOR) - 4.0).abs() < 0.8, "{}", variance.variance(0.0, &PRIOR));
        assert!((variance.variance(1.0, &PRIOR) - 13.0).abs() < 1.5, "{}", variance.variance(1.0, &PRIOR));
        assert!(variance.is_sound());
    }

    #[test]
    fn an_outlier_counts_little_and_no_variance_is_negative() {
        let mut variance = DifferenceVariance::zeroed();
        for _ in 0..1000 {
            variance.update(1.0, 0.0, 0.01, &PRIOR);
        }
        variance.update(1e9, 0.0, 0.01, &PRIOR);
        let before = variance;
        for (difference, intensity) in [(f64::NAN, 0.0), (f64::INFINITY, 0.0), (0.0, f64::NAN)] {
            variance.update(difference, intensity, 0.01, &PRIOR);
        }
        assert_eq!(bytemuck::bytes_of(&variance), bytemuck::bytes_of(&before));
        assert!(variance.variance(0.0, &PRIOR) < 1.1);
        // Large differences at rest, none in motion.
        for _ in 0..1000 {
            variance.update(0.0, 3.0, 0.01, &PRIOR);
        }
        assert!(variance.variance(10.0, &PRIOR) >= 0.0 && variance.variance(0.0, &PRIOR) > 0.5);
    }
}
