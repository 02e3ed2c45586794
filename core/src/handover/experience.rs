//! Correction of predicted limit ratios by measurements from earlier handovers.
//!
//! The posture model omits individual habits, so its error is correlated over neighbouring places. The ratio of the measured
//! to the predicted limit ratio, minus one, is a Gaussian process over the places (Rasmussen & Williams 2006, Eq. 2.25 and
//! 2.26) with a squared exponential covariance; its standard deviation is that of the prediction.

use nalgebra::{SMatrix, SVector, Vector3};

use crate::math;

/// Maximum number of stored handovers; a new one replaces the oldest.
const MEMORY: usize = 24;
/// Distance over which a posture changes about as much as its model errs, m: half an arm.
const LENGTH_M: f64 = 0.3;
/// 1-σ of a measured ratio: grips and torques of one handover differ from those of the next by some per cent.
const MEASURED_SIGMA: f64 = 0.05;

/// Measured over predicted limit ratios of earlier handovers.
#[derive(Debug, Clone, Copy)]
pub struct Experience {
    place_m: [Vector3<f64>; MEMORY],
    excess: [f64; MEMORY],
    count: usize,
}

impl Default for Experience {
    fn default() -> Self {
        Experience { place_m: [Vector3::zeros(); MEMORY], excess: [0.0; MEMORY], count: 0 }
    }
}

/// A corrected limit ratio with its 1-σ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corrected {
    /// Limit ratio of the worst joint.
    pub limit_ratio: f64,
    /// Its 1-σ.
    pub sigma: f64,
}

impl Experience {
    /// Number of handovers.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Adds the worst joint's limit ratio measured in a handover at `place_m` (relative to the feet, as
    /// [`super::FootPlacement::world_m`], m). Ratios that are not positive numbers change nothing.
    pub fn observe(&mut self, place_m: Vector3<f64>, predicted_ratio: f64, measured_ratio: f64) {
        let excess = measured_ratio / predicted_ratio - 1.0;
        let is_usable = |limit_ratio: f64| limit_ratio > 0.0 && limit_ratio < f64::MAX;
        if !(is_usable(predicted_ratio) && is_usable(measured_ratio) && excess.is_finite()) {
            return;
        }
        let index = self.count % MEMORY;
        (self.place_m[index], self.excess[index]) = (place_m, excess);
        self.count += 1;
    }

    /// Corrects a prediction at a place.
    pub fn correct(&self, place_m: Vector3<f64>, predicted_ratio: f64, predicted_sigma: f64) -> Corrected {
        let relative = predicted_sigma / predicted_ratio;
        let variance = relative * relative;
        let covariance = |a: Vector3<f64>, b: Vector3<f64>| {
            variance * math::exp(-0.5 * (a - b).norm_squared() / (LENGTH_M * LENGTH_M))
        };
        let used = self.count.min(MEMORY);
        // Unused rows are those of the identity, and contribute nothing.
        let mut all = SMatrix::<f64, MEMORY, MEMORY>::identity();
        let mut here = SVector::<f64, MEMORY>::zeros();
        for row in 0..used {
            here[row] = covariance(place_m, self.place_m[row]);
            for column in 0..used {
                all[(row, column)] = covariance(self.place_m[row], self.place_m[column]);
            }
            all[(row, row)] += MEASURED_SIGMA * MEASURED_SIGMA;
        }
        let Some(weights) = all.cholesky().map(|factor| factor.solve(&here)) else {
            return Corrected { limit_ratio: predicted_ratio, sigma: predicted_sigma };
        };
        let excess: f64 = (0..used).map(|row| weights[row] * self.excess[row]).sum();
        let left = (variance - weights.dot(&here)).max(0.0);
        Corrected {
            limit_ratio: predicted_ratio * (1.0 + excess).max(0.0),
            sigma: predicted_ratio * math::sqrt(left),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: Vector3<f64> = Vector3::new(0.4, 0.1, 1.1);

    #[test]
    fn without_experience_nothing_is_corrected() {
        assert_eq!(
            Experience::default().correct(PLACE, 0.5, 0.1),
            Corrected { limit_ratio: 0.5, sigma: 0.1 }
        );
    }

    #[test]
    fn one_handover_corrects_its_place_as_a_mean_of_two_values_and_a_far_place_not_at_all() {
        let mut experience = Experience::default();
        experience.observe(PLACE, 0.4, 0.6);
        let near = experience.correct(PLACE, 0.5, 0.1);
        // Relative σ 0.2 of the prediction and 0.05 of the measurement: weight 0.04 / 0.0425.
        assert!((near.limit_ratio - 0.5 * (1.0 + 0.5 * 0.04 / 0.0425)).abs() < 1e-12, "{near:?}");
        assert!((near.sigma - 0.5 * 0.2 * 0.05 / 0.0425f64.sqrt()).abs() < 1e-12, "{near:?}");
        let far = experience.correct(PLACE + Vector3::new(0.0, 0.0, 3.0), 0.5, 0.1);
        assert!((far.limit_ratio - 0.5).abs() < 1e-9 && (far.sigma - 0.1).abs() < 1e-9, "{far:?}");
    }

    #[test]
    fn old_handovers_are_dropped_and_impossible_ratios_ignored() {
        let mut experience = Experience::default();
        for limit_ratio in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            experience.observe(PLACE, 0.5, limit_ratio);
            experience.observe(PLACE, limit_ratio, 0.5);
        }
        assert_eq!(experience.count(), 0);
        for _ in 0..MEMORY {
            experience.observe(PLACE, 0.5, 2.0);
        }
        for _ in 0..MEMORY {
            experience.observe(PLACE, 0.5, 0.5);
        }
        assert!((experience.correct(PLACE, 0.5, 0.1).limit_ratio - 0.5).abs() < 1e-12);
    }
}
