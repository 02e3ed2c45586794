//! Likelihood of a channel's residuals given the sizes of its kernels, and the most probable sizes: a small
//! quasi-Newton search between bounds, with a gradient and a good initial curvature.

use nalgebra::DMatrix;

use crate::block::Phase;
use crate::constants::{
    FIT_BLOCKS_MAX, INITIAL_CURVATURE, MINIMISER_GAIN_MIN, MINIMISER_STEP, MINIMISER_STEPS,
};
use crate::linear::{Factor, column, dot, outer};
use crate::rows::Rows;

/// The parts of a channel's likelihood that do not depend on the sizes.
pub(super) struct ChannelLikelihood<const N: usize> {
    /// Covariance of the parts without a fitted size.
    pub(super) fixed: DMatrix<f64>,
    /// Parts of unit size; `None` for the white one, which `add_white` adds.
    pub(super) parts: [Option<DMatrix<f64>>; N],
    /// One column.
    pub(super) residual: DMatrix<f64>,
    /// Adds the white part of these sizes.
    pub(super) add_white: fn(&mut DMatrix<f64>, &[f64; N]),
}

/// Prior of the logarithms of the sizes, and their bounds.
#[derive(Debug, Clone, Copy)]
pub(super) struct SizePrior<const N: usize> {
    pub(super) mean: [f64; N],
    pub(super) sigma: [f64; N],
    pub(super) min: [f64; N],
    pub(super) max: [f64; N],
}

impl<const N: usize> ChannelLikelihood<N> {
    /// Logarithms of the sizes of largest posterior density. `None` if the residuals are not finite.
    pub(super) fn most_probable(&self, prior: &SizePrior<N>) -> Option<[f64; N]> {
        let SizePrior { mean, sigma, min, max } = *prior;
        let curvature = sigma.map(|sigma| 1.0 / (sigma * sigma) + INITIAL_CURVATURE);
        minimise(mean, min, max, curvature, |sizes| {
            let (mut value, mut slope) = self.minus_log_likelihood(sizes)?;
            for i in 0..N {
                let off = (sizes[i] - mean[i]) / sigma[i];
                value += 0.5 * off * off;
                slope[i] += off / sigma[i];
            }
            Some((value, slope))
        })
    }

    /// The value and its gradient with respect to the logarithms of the sizes.
    fn minus_log_likelihood(&self, sizes: &[f64; N]) -> Option<(f64, [f64; N])> {
        let mut covariance = self.fixed.clone();
        for (part, &size) in self.parts.iter().zip(sizes) {
            if let Some(part) = part {
                covariance += (2.0 * size).exp() * part;
            }
        }
        (self.add_white)(&mut covariance, sizes);
        let factor = Factor::of(&covariance)?;
        let mut weighted = self.residual.clone();
        factor.whiten_from(0, &mut weighted);
        let value = 0.5 * weighted.norm_squared() + factor.half_log_det();
        factor.solve_transposed(&mut weighted);
        let mut inverse = factor.inverse();
        inverse -= outer(&weighted, &weighted);
        let slope = std::array::from_fn(|part| {
            let trace = match &self.parts[part] {
                Some(shape) => elementwise_product_sum(&inverse, shape),
                None => (0..inverse.nrows()).map(|i| inverse[(i, i)]).sum(),
            };
            (2.0 * sizes[part]).exp() * trace
        });
        value.is_finite().then_some((value, slope))
    }
}

/// Evenly spaced blocks of poses and clean work: indices.
pub(super) fn blocks_of_fit(rows: &Rows<'_>) -> Vec<usize> {
    let mut chosen = Vec::new();
    for (phase, max) in [Phase::Identify, Phase::Reference].into_iter().zip(FIT_BLOCKS_MAX) {
        let all: Vec<usize> = (0..rows.len()).filter(|&i| rows.blocks[i].phase == phase).collect();
        let count = all.len().min(max);
        chosen.extend((0..count).map(|i| all[i * all.len() / count]));
    }
    chosen
}

/// Sum of the elementwise products.
fn elementwise_product_sum(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (0..a.ncols()).map(|j| dot(column(a, j), column(b, j))).sum()
}

/// Minimises `of` (value and gradient; `None` where it is undefined) from `start`, within `min` and `max`.
/// `curvature` is the diagonal of an approximate second derivative.
fn minimise<const N: usize>(
    start: [f64; N],
    min: [f64; N],
    max: [f64; N],
    curvature: [f64; N],
    of: impl Fn(&[f64; N]) -> Option<(f64, [f64; N])>,
) -> Option<[f64; N]> {
    let mut at = start;
    let (mut value, mut slope) = of(&at)?;
    let mut inverse: [[f64; N]; N] =
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 / curvature[i] } else { 0.0 }));
    let (steps, _) = MINIMISER_STEPS;
    for _ in 0..steps {
        let direction: [f64; N] =
            std::array::from_fn(|i| -(0..N).map(|j| inverse[i][j] * slope[j]).sum::<f64>());
        let Some((next, next_value, next_slope)) = search(&at, value, &direction, &min, &max, &of) else {
            break;
        };
        let step: [f64; N] = std::array::from_fn(|i| next[i] - at[i]);
        let change: [f64; N] = std::array::from_fn(|i| next_slope[i] - slope[i]);
        update(&mut inverse, &step, &change);
        let gained = value - next_value;
        (at, value, slope) = (next, next_value, next_slope);
        if gained < MINIMISER_GAIN_MIN {
            break;
        }
    }
    Some(at)
}

/// Position, value and gradient.
type Point<const N: usize> = ([f64; N], f64, [f64; N]);

/// Shortens the step until the value decreases.
fn search<const N: usize>(
    at: &[f64; N],
    value: f64,
    direction: &[f64; N],
    min: &[f64; N],
    max: &[f64; N],
    of: impl Fn(&[f64; N]) -> Option<(f64, [f64; N])>,
) -> Option<Point<N>> {
    let longest = direction.iter().fold(0.0_f64, |longest, step| longest.max(step.abs()));
    let ((step_max, shortening), (_, tries)) = (MINIMISER_STEP, MINIMISER_STEPS);
    let mut step_fraction = if longest > step_max { step_max / longest } else { 1.0 };
    for _ in 0..tries {
        let next: [f64; N] =
            std::array::from_fn(|i| (at[i] + step_fraction * direction[i]).clamp(min[i], max[i]));
        if let Some((next_value, slope)) = of(&next)
            && next_value < value
        {
            return Some((next, next_value, slope));
        }
        step_fraction *= shortening;
    }
    None
}

/// The update of Broyden, Fletcher, Goldfarb and Shanno of an inverse curvature.
fn update<const N: usize>(inverse: &mut [[f64; N]; N], step: &[f64; N], change: &[f64; N]) {
    let along: f64 = (0..N).map(|i| step[i] * change[i]).sum();
    if along <= 1e-10 {
        return;
    }
    let moved: [f64; N] = std::array::from_fn(|i| (0..N).map(|j| inverse[i][j] * change[j]).sum());
    let scale = (1.0 + (0..N).map(|i| change[i] * moved[i]).sum::<f64>() / along) / along;
    for i in 0..N {
        for j in 0..N {
            inverse[i][j] += scale * step[i] * step[j] - (moved[i] * step[j] + step[i] * moved[j]) / along;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_minimum_of_a_curved_valley_within_bounds() {
        let valley = |at: &[f64; 2]| {
            let (a, b) = (1.0 - at[0], at[1] - at[0] * at[0]);
            Some((20.0 * (a * a + 5.0 * b * b), [-40.0 * a - 400.0 * b * at[0], 200.0 * b]))
        };
        let free = minimise([-0.5, 1.0], [-9.0; 2], [9.0; 2], [40.0, 200.0], valley).unwrap();
        assert!((free[0] - 1.0).abs() < 0.1, "{free:?}");
        let bound = minimise([-0.5, 1.0], [-9.0; 2], [0.5, 9.0], [40.0, 200.0], valley).unwrap();
        assert!(bound[0] <= 0.5 && bound[0] > 0.4, "{bound:?}");
    }
}
