//! Likelihood of residuals given the sizes of kernels, and the sizes that maximise it; for every channel alike.

use faer::Mat;

use super::minimise::minimise;
use crate::block::Phase;
use crate::linear::{Factor, dot, outer};
use crate::rows::Rows;

/// Maximum numbers of blocks in a fit: of poses and of clean work.
const FIT_MAX: [usize; 2] = [70, 150];

/// The parts of a channel's likelihood that do not depend on the sizes.
pub(super) struct Question<const N: usize> {
    /// Covariance of the parts without a fitted size.
    pub(super) fixed: Mat<f64>,
    /// Parts of unit size; `None` for the white one, which `add_white` adds.
    pub(super) parts: [Option<Mat<f64>>; N],
    /// One column.
    pub(super) residual: Mat<f64>,
    /// Adds the white part of these sizes.
    pub(super) add_white: fn(&mut Mat<f64>, &[f64; N]),
}

/// Prior of the logarithms of the sizes, and their bounds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Belief<const N: usize> {
    pub(super) mean: [f64; N],
    pub(super) sigma: [f64; N],
    pub(super) least: [f64; N],
    pub(super) most: [f64; N],
}

impl<const N: usize> Question<N> {
    /// Logarithms of the most likely sizes. `None` if the residuals are not finite.
    pub(super) fn likeliest(&self, belief: &Belief<N>) -> Option<[f64; N]> {
        let Belief { mean, sigma, least, most } = *belief;
        let curvature = sigma.map(|sigma| 1.0 / (sigma * sigma) + 10.0);
        minimise(mean, least, most, curvature, |sizes| {
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
                covariance += faer::Scale((2.0 * size).exp()) * part;
            }
        }
        (self.add_white)(&mut covariance, sizes);
        let factor = Factor::of(&covariance)?;
        let mut weighted = self.residual.clone();
        factor.whiten_from(0, &mut weighted);
        let value = 0.5 * weighted.squared_norm_l2() + factor.half_log_det();
        factor.back(&mut weighted);
        let mut inverse = Factor::inverse(&covariance)?;
        inverse -= outer(weighted.as_ref(), weighted.as_ref());
        let slope = std::array::from_fn(|part| {
            let trace = match &self.parts[part] {
                Some(shape) => all_products(&inverse, shape),
                None => (0..inverse.nrows()).map(|i| inverse[(i, i)]).sum(),
            };
            (2.0 * sizes[part]).exp() * trace
        });
        value.is_finite().then_some((value, slope))
    }
}

/// Evenly spaced blocks of poses and clean work: indices.
pub(super) fn chosen(rows: &Rows<'_>) -> Vec<usize> {
    let mut chosen = Vec::new();
    for (phase, most) in [Phase::Identify, Phase::Reference].into_iter().zip(FIT_MAX) {
        let all: Vec<usize> = (0..rows.len()).filter(|&i| rows.blocks[i].phase == phase).collect();
        let count = all.len().min(most);
        chosen.extend((0..count).map(|i| all[i * all.len() / count]));
    }
    chosen
}

/// Sum of the elementwise products.
fn all_products(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
    (0..a.ncols()).map(|j| dot(a.col_as_slice(j), b.col_as_slice(j))).sum()
}
