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
/// Largest excess: ten times the prediction is the load of another object, not the posture of this one.
const EXCESS_MAX: f64 = 9.0;

/// A measured handover.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Handover {
    /// Place relative to the feet, as in [`super::FootPlacement::world_m`], m.
    pub place_m: [f64; 3],
    /// Measured over predicted limit ratio of the worst joint, minus one.
    pub excess: f64,
    /// 1-σ of the measurement, as a fraction of it.
    pub sigma: f64,
}

impl Handover {
    /// Whether every number is in range: a place within [`super::PLACE_MAX_M`], positive limit ratios that differ by a
    /// factor of at most ten, and a σ in [0, 1].
    pub fn is_sound(&self) -> bool {
        self.place_m.iter().all(|metres| metres.abs() <= super::PLACE_MAX_M)
            && self.excess > -1.0
            && self.excess <= EXCESS_MAX
            && (0.0..=1.0).contains(&self.sigma)
    }
}

/// Measured over predicted limit ratios of earlier handovers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Experience {
    /// The first `count`, or all, are in use; the oldest is at `count` modulo the length once all are.
    handovers: [Handover; MEMORY],
    count: usize,
}

/// A limit ratio with its 1-σ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitRatio {
    /// Limit ratio of the worst joint.
    pub value: f64,
    /// Its 1-σ.
    pub sigma: f64,
}

impl Experience {
    /// Number of handovers in use.
    pub fn count(&self) -> usize {
        self.count.min(MEMORY)
    }

    /// The handovers in use, oldest first.
    pub fn handovers(&self) -> impl Iterator<Item = &Handover> {
        let used = self.count();
        (self.count - used..self.count).map(|index| &self.handovers[index % MEMORY])
    }

    /// Adds a handover; one that is not sound changes nothing. Returns whether it was added.
    pub fn add(&mut self, handover: Handover) -> bool {
        if handover.is_sound() {
            self.handovers[self.count % MEMORY] = handover;
            self.count += 1;
        }
        handover.is_sound()
    }

    /// Adds the worst joint's limit ratio measured in a handover at `place_m` (relative to the feet, as in
    /// [`super::FootPlacement::world_m`], m). Returns whether it was added: ratios that are not positive numbers are not.
    pub fn observe(&mut self, place_m: Vector3<f64>, predicted: f64, measured: LimitRatio) -> bool {
        let (excess, sigma) = (measured.value / predicted - 1.0, measured.sigma / measured.value);
        predicted > 0.0 && self.add(Handover { place_m: place_m.into(), excess, sigma })
    }

    /// Corrects a prediction at a place.
    pub fn correct(&self, place_m: Vector3<f64>, predicted: LimitRatio) -> LimitRatio {
        let used = self.count();
        if used == 0 {
            return predicted;
        }
        let relative = predicted.sigma / predicted.value;
        let variance = relative * relative;
        let covariance = |a: Vector3<f64>, b: Vector3<f64>| {
            variance * math::exp(-0.5 * (a - b).norm_squared() / (LENGTH_M * LENGTH_M))
        };
        // Unused rows are those of the identity, and contribute nothing.
        let mut all = SMatrix::<f64, MEMORY, MEMORY>::identity();
        let mut here = SVector::<f64, MEMORY>::zeros();
        for (row, handover) in self.handovers[..used].iter().enumerate() {
            let at_m = Vector3::from(handover.place_m);
            here[row] = covariance(place_m, at_m);
            for (column, other) in self.handovers[..used].iter().enumerate() {
                all[(row, column)] = covariance(at_m, Vector3::from(other.place_m));
            }
            all[(row, row)] += MEASURED_SIGMA * MEASURED_SIGMA + handover.sigma * handover.sigma;
        }
        let Some(weights) = all.cholesky().map(|factor| factor.solve(&here)) else { return predicted };
        let excess: f64 = (0..used).map(|row| weights[row] * self.handovers[row].excess).sum();
        let left = (variance - weights.dot(&here)).max(0.0);
        LimitRatio {
            value: predicted.value * (1.0 + excess).max(0.0),
            sigma: predicted.value * math::sqrt(left),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: Vector3<f64> = Vector3::new(0.4, 0.1, 1.1);
    const PREDICTED: LimitRatio = LimitRatio { value: 0.5, sigma: 0.1 };

    fn exact(value: f64) -> LimitRatio {
        LimitRatio { value, sigma: 0.0 }
    }

    #[test]
    fn without_experience_nothing_is_corrected() {
        assert_eq!(Experience::default().correct(PLACE, PREDICTED), PREDICTED);
    }

    #[test]
    fn one_handover_corrects_its_place_as_a_mean_of_two_values_and_a_far_place_not_at_all() {
        for (sigma, measured_variance) in [(0.0, 0.0025), (0.06, 0.0025 + 0.01)] {
            let mut experience = Experience::default();
            assert!(experience.observe(PLACE, 0.4, LimitRatio { value: 0.6, sigma }));
            let near = experience.correct(PLACE, PREDICTED);
            // Relative σ 0.2 of the prediction: weight 0.04 over the sum of both variances.
            let sum = 0.04 + measured_variance;
            assert!((near.value - 0.5 * (1.0 + 0.5 * 0.04 / sum)).abs() < 1e-12, "{near:?}");
            assert!((near.sigma - 0.5 * (0.04 * measured_variance / sum).sqrt()).abs() < 1e-12, "{near:?}");
            let far = experience.correct(PLACE + Vector3::new(0.0, 0.0, 3.0), PREDICTED);
            assert!((far.value - 0.5).abs() < 1e-9 && (far.sigma - 0.1).abs() < 1e-9, "{far:?}");
        }
    }

    #[test]
    fn old_handovers_are_dropped_and_impossible_ratios_ignored() {
        let mut experience = Experience::default();
        for ratio in [0.0, -1.0, f64::NAN, f64::INFINITY, 6.0] {
            assert!(!experience.observe(PLACE, 0.5, exact(ratio)), "{ratio}");
            assert!(ratio == 6.0 || !experience.observe(PLACE, ratio, exact(0.5)), "{ratio}");
        }
        assert!(!experience.observe(PLACE, 0.5, LimitRatio { value: 0.5, sigma: 0.6 }));
        assert!(!experience.observe(10.0 * PLACE, 0.5, exact(0.5)));
        assert_eq!(experience.count(), 0);
        for _ in 0..MEMORY {
            experience.observe(PLACE, 0.5, exact(2.0));
        }
        for number in 0..MEMORY {
            experience.observe(PLACE, 0.5, exact(0.5 + 1e-9 * number as f64));
        }
        assert!((experience.correct(PLACE, PREDICTED).value - 0.5).abs() < 1e-7);
        assert_eq!(experience.handovers().count(), MEMORY);
        assert!(experience.handovers().is_sorted_by(|a, b| a.excess < b.excess), "{experience:?}");
        assert!(experience.handovers().all(|handover| handover.excess < 1e-6));
    }
}
