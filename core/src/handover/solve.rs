//! The most probable posture by Levenberg and Marquardt's method, and the covariance around it.

use nalgebra::{SMatrix, SVector};

use super::Holding;
use super::coordinates::{COORDINATES, Coordinates, MEAN};

/// Residuals: one per coordinate, three per hand, two of the balance, the slope of each hand.
pub(super) const RESIDUALS: usize = COORDINATES + 10;
/// Step of the difference quotients, rad and m: the square root of the rounding error.
pub(super) const STEP: f64 = 1e-7;
/// Upper bound of the iterations; some ten suffice.
const ITERATIONS_MAX: usize = 60;
/// First damping, as a fraction of the diagonal, and its factor after each step (Marquardt 1963).
const DAMPING: f64 = 1e-3;
const DAMPING_FACTOR: f64 = 10.0;
/// Beyond it no step improves the sum of squares.
const DAMPING_MAX: f64 = 1e9;
/// Relative decrease of the sum of squares at which the search ends.
const DECREASE_MIN: f64 = 1e-9;

type Square = SMatrix<f64, COORDINATES, COORDINATES>;
type Vector = SVector<f64, COORDINATES>;

/// A posture with its covariance.
pub(super) struct Solution {
    pub(super) coordinates: Coordinates,
    /// JᵀJ: the inverse of the covariance.
    information: Square,
}

impl Solution {
    /// Variance of a function of the coordinates with this slope.
    pub(super) fn variance_along(&self, slope: &Coordinates) -> f64 {
        let slope = Vector::from(*slope);
        // The zones alone make the matrix positive definite.
        self.information.cholesky().map_or(f64::INFINITY, |factor| slope.dot(&factor.solve(&slope)))
    }
}

/// Minimises the sum of squared residuals.
pub(super) fn most_probable(holding: &Holding<'_>) -> Solution {
    let mut at = MEAN;
    let mut residual = holding.residuals(&at);
    let mut sum = square(&residual);
    let mut damping = DAMPING;
    let (mut information, mut gradient) = normal_equations(holding, &at, &residual);
    for _ in 0..ITERATIONS_MAX {
        let mut damped = information;
        for index in 0..COORDINATES {
            damped[(index, index)] *= 1.0 + damping;
        }
        let Some(step) = damped.cholesky().map(|factor| factor.solve(&gradient)) else { break };
        let moved: Coordinates = core::array::from_fn(|index| at[index] - step[index]);
        let moved_residual = holding.residuals(&moved);
        let moved_sum = square(&moved_residual);
        // False for NaN.
        if moved_sum < sum {
            let is_done = sum - moved_sum < DECREASE_MIN * sum && damping <= DAMPING;
            (at, residual, sum) = (moved, moved_residual, moved_sum);
            (information, gradient) = normal_equations(holding, &at, &residual);
            damping /= DAMPING_FACTOR;
            if is_done {
                break;
            }
        } else {
            damping *= DAMPING_FACTOR;
            if damping > DAMPING_MAX {
                break;
            }
        }
    }
    Solution { coordinates: at, information }
}

fn square(residual: &[f64; RESIDUALS]) -> f64 {
    residual.iter().map(|value| value * value).sum()
}

/// JᵀJ and Jᵀr.
fn normal_equations(
    holding: &Holding<'_>,
    at: &Coordinates,
    residual: &[f64; RESIDUALS],
) -> (Square, Vector) {
    let mut jacobian = SMatrix::<f64, RESIDUALS, COORDINATES>::zeros();
    for index in 0..COORDINATES {
        let mut moved = *at;
        moved[index] += STEP;
        for (row, (moved, here)) in holding.residuals(&moved).iter().zip(residual).enumerate() {
            jacobian[(row, index)] = (moved - here) / STEP;
        }
    }
    let residual = SVector::<f64, RESIDUALS>::from(*residual);
    (jacobian.transpose() * jacobian, jacobian.transpose() * residual)
}
