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
    /// 1-σ of the published torque, as a fraction of the measurement: one error of all measurements.
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
    /// [`super::FootPlacement::world_m`], m). Returns whether it was added: what [`Handover::is_sound`] rejects is not.
    pub fn observe(&mut self, place_m: Vector3<f64>, predicted: f64, measured: LimitRatio) -> bool {
        let (excess, sigma) = (measured.value / predicted - 1.0, measured.sigma / measured.value);
        predicted > 0.0 && self.add(Handover { place_m: place_m.into(), excess, sigma })
    }

    /// Corrects a prediction at a place.
    pub fn correct(&self, place_m: Vector3<f64>, predicted: LimitRatio) -> LimitRatio {
        let Some(posterior) = self.posterior([place_m; 1], [predicted]) else { return predicted };
        let (excess, variance) = (posterior.0[0], posterior.1[(0, 0)]);
        LimitRatio {
            value: predicted.value * (1.0 + excess).max(0.0),
            sigma: predicted.value * math::sqrt(variance.max(0.0)),
        }
    }

    /// Limit ratio at the first of two places less that at the second, with the predictions there. Its σ is smaller than
    /// that of independent values: the errors of near places are alike.
    pub fn difference(&self, place_m: [Vector3<f64>; 2], predicted: [LimitRatio; 2]) -> LimitRatio {
        let [here, there] = predicted.map(|predicted| predicted.value);
        let Some((excess, covariance)) = self.posterior(place_m, predicted) else {
            return LimitRatio {
                value: here - there,
                sigma: math::hypot(predicted.map(|ratio| ratio.sigma)),
            };
        };
        let variance = here * here * covariance[(0, 0)] + there * there * covariance[(1, 1)]
            - 2.0 * here * there * covariance[(0, 1)];
        LimitRatio {
            value: here * (1.0 + excess[0]) - there * (1.0 + excess[1]),
            sigma: math::sqrt(variance.max(0.0)),
        }
    }

    /// Mean and covariance of the excess at places with these predictions; `None` if it cannot be computed.
    ///
    /// The σ of a published torque is mostly of errors that persist (the body model, the load's place in the hands), so it
    /// counts as one error of all measurements: it says little about the level and nothing about differences.
    fn posterior<const N: usize>(
        &self,
        place_m: [Vector3<f64>; N],
        predicted: [LimitRatio; N],
    ) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
        // One variance for all places, so that the covariance is one.
        let relative = predicted.map(|predicted| predicted.sigma / predicted.value);
        let variance = relative.iter().map(|sigma| sigma * sigma).sum::<f64>() / N as f64;
        let covariance = |a: Vector3<f64>, b: Vector3<f64>| {
            variance * math::exp(-0.5 * (a - b).norm_squared() / (LENGTH_M * LENGTH_M))
        };
        let prior = SMatrix::<f64, N, N>::from_fn(|row, column| covariance(place_m[row], place_m[column]));
        // Unused rows are those of the identity, and contribute nothing.
        let mut all = SMatrix::<f64, MEMORY, MEMORY>::identity();
        let mut across = SMatrix::<f64, MEMORY, N>::zeros();
        let mut excess = SVector::<f64, MEMORY>::zeros();
        let used = &self.handovers[..self.count()];
        for (row, handover) in used.iter().enumerate() {
            let at_m = Vector3::from(handover.place_m);
            excess[row] = handover.excess;
            for (column, place_m) in place_m.iter().enumerate() {
                across[(row, column)] = covariance(*place_m, at_m);
            }
            for (column, other) in used.iter().enumerate() {
                all[(row, column)] =
                    covariance(at_m, Vector3::from(other.place_m)) + handover.sigma * other.sigma;
            }
            all[(row, row)] += MEASURED_SIGMA * MEASURED_SIGMA;
        }
        let weights = all.cholesky()?.solve(&across);
        Some((weights.transpose() * excess, prior - weights.transpose() * across))
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
    fn differences_between_measured_places_are_known_better_than_their_level() {
        let (near, far) = (PLACE, PLACE + Vector3::new(0.2, 0.0, -0.2));
        let mut experience = Experience::default();
        for (place_m, value) in [(near, 0.5), (far, 0.8)] {
            assert!(experience.observe(place_m, 0.5, LimitRatio { value, sigma: 0.4 * value }));
        }
        let [here, there] = [far, near].map(|place_m| experience.correct(place_m, PREDICTED));
        let difference = experience.difference([far, near], [PREDICTED; 2]);
        assert!((difference.value - (here.value - there.value)).abs() < 1e-12);
        assert!(difference.value > 2.0 * difference.sigma, "{difference:?}");
        assert!(difference.sigma < 0.5 * here.sigma.hypot(there.sigma), "{difference:?} {here:?} {there:?}");
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
