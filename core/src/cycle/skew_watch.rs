//! Feeds the skew between both streams with what motion shows of it, while nothing is carried.

use bytemuck::{Pod, Zeroable};

use crate::time::skew::{SkewEstimator, joint};

/// Vertical acceleration, and the centre of pressure forward and sideways.
pub(super) const QUANTITIES: usize = 3;
/// Moments farther apart than this have no slope between them, s.
const STEP_MAX_S: f64 = 0.1;

/// One moment: what the plate measured, what the suit's motion predicts, and 1-σ of their difference.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Shown {
    pub(super) time_s: f64,
    pub(super) measured: [f64; QUANTITIES],
    pub(super) predicted: [f64; QUANTITIES],
    pub(super) sigma: [f64; QUANTITIES],
}

/// An estimator for each quantity, and the last two moments: a slope needs neighbours on both sides.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SkewWatch {
    estimators: [SkewEstimator; QUANTITIES],
    last: [Shown; 2],
    /// How many of `last` follow each other, in [0, 2].
    known: u64,
}

impl SkewWatch {
    /// Takes in the next moment; the one before it becomes a row of each estimator.
    pub(super) fn take_in(&mut self, shown: Shown) {
        let step_s = shown.time_s - self.last[1].time_s;
        if self.known > 0 && !(step_s > 0.0 && step_s < STEP_MAX_S) {
            self.known = 0;
        }
        if self.known == 2 {
            let [before, here] = self.last;
            for (quantity, estimator) in self.estimators.iter_mut().enumerate() {
                let slope =
                    (shown.predicted[quantity] - before.predicted[quantity]) / (shown.time_s - before.time_s);
                let [measured, predicted] = [here.measured[quantity], here.predicted[quantity]];
                estimator.update(
                    measured,
                    predicted,
                    slope,
                    here.sigma[quantity],
                    here.time_s - before.time_s,
                );
            }
        }
        self.last = [self.last[1], shown];
        self.known = (self.known + 1).min(2);
    }

    /// Nothing follows what came before: a load, a gap.
    pub(super) fn interrupt(&mut self) {
        self.known = 0;
    }

    /// How much later the suit's sample times are than the ground's, and its 1-σ, s; `None` while not shown.
    pub(super) fn estimate(&self) -> Option<(f64, f64)> {
        joint(&self.estimators)
    }

    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        let finite = |shown: &Shown| {
            let numbers = shown.measured.iter().chain(&shown.predicted).chain(&shown.sigma);
            numbers.chain([&shown.time_s]).all(|value| value.is_finite())
        };
        self.known <= 2 && self.last.iter().all(finite) && self.estimators.iter().all(SkewEstimator::is_sound)
    }
}
