//! Error of the inertia compensation, estimated from motion without a load.
//!
//! Accelerations from positions have an error proportional to their size: samples are late, bones are not rigid, the
//! suit smooths. So the error of the compensation grows with its size, the *activity*, and the ratio of the two is
//! estimated while no load is carried.

use bytemuck::{Pod, Zeroable};

use crate::math;

/// Prior of the ratio: an eighth of the compensation is wrong.
const RATIO_PRIOR: f64 = 0.125;
/// Weight of the prior, in samples.
const SAMPLES_PRIOR: f64 = 60.0;
/// Averaging length, in samples.
const SAMPLES_KEPT: f64 = 6000.0;
/// Lower bound of the ratio.
const RATIO_MIN: f64 = 0.02;

/// Error over activity of one quantity.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Confidence {
    /// Mean of error² over activity², and the number of samples in it.
    ratio_square: f64,
    samples: f64,
}

impl Confidence {
    /// Ingests an error without another explanation, with the activity at that time; both in the same unit.
    pub fn update(&mut self, error: f64, activity: f64, error_at_rest: f64) {
        // Small motion has no information on the ratio.
        if activity * activity <= error_at_rest * error_at_rest || !error.is_finite() {
            return;
        }
        // Limit the influence of a single outlier, which would otherwise last for minutes.
        let square =
            ((error * error - error_at_rest * error_at_rest) / (activity * activity)).clamp(0.0, 1.0);
        self.samples = (self.samples + 1.0).min(SAMPLES_KEPT);
        self.ratio_square += (square - self.ratio_square) / self.samples;
    }

    /// 1-σ of an error at an activity, in its unit.
    pub fn sigma(&self, activity: f64) -> f64 {
        let sum_square = self.samples * self.ratio_square;
        let prior_square = SAMPLES_PRIOR * RATIO_PRIOR * RATIO_PRIOR;
        let ratio = math::sqrt((sum_square + prior_square) / (self.samples + SAMPLES_PRIOR));
        ratio.max(RATIO_MIN) * activity
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        (0.0..=1.0).contains(&self.ratio_square) && (0.0..=SAMPLES_KEPT).contains(&self.samples)
    }
}

/// Decay time of the envelope, s: motion continues while its acceleration crosses zero.
const FADING_S: f64 = 0.25;

/// Decaying maximum of a varying quantity.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Envelope {
    height: f64,
}

impl Envelope {
    /// Ingests a value `step_s` after the previous one.
    pub fn update(&mut self, value: f64, step_s: f64) -> f64 {
        // 1/(1 + x) for e^(−x): close for the short steps of a sample, and never negative.
        let faded = self.height / (1.0 + step_s.max(0.0) / FADING_S);
        self.height = value.abs().max(faded);
        self.height
    }

    /// The present value.
    pub fn height(&self) -> f64 {
        self.height
    }

    /// Whether the number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        self.height.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ratio_of_error_to_activity_is_estimated() {
        let mut confidence = Confidence::zeroed();
        for index in 0..3000 {
            let activity = 10.0 + f64::from(index % 7);
            let error = 0.3 * activity * if index % 2 == 0 { 1.0 } else { -1.0 };
            confidence.update(error, activity, 0.0);
        }
        assert!((confidence.sigma(20.0) - 6.0).abs() < 0.2, "{}", confidence.sigma(20.0));
    }

    #[test]
    fn rest_changes_nothing_and_an_outlier_little() {
        let mut confidence = Confidence::zeroed();
        let before = confidence.sigma(1.0);
        for _ in 0..1000 {
            confidence.update(1.0, 0.5, 1.0);
        }
        assert_eq!(confidence.sigma(1.0), before);
        confidence.update(1e6, 2.0, 1.0);
        confidence.update(f64::NAN, 2.0, 1.0);
        assert!(confidence.sigma(1.0) < 2.0 * before && confidence.is_sound());
    }

    #[test]
    fn an_envelope_rises_at_once_and_fades() {
        let mut envelope = Envelope::zeroed();
        assert_eq!(envelope.update(-3.0, 0.01), 3.0);
        let mut height = 3.0;
        for _ in 0..50 {
            let now = envelope.update(0.0, 0.01);
            assert!(now < height);
            height = now;
        }
        assert!(height < 0.45, "{height}");
    }
}
