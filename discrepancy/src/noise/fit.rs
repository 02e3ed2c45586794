//! The sizes of the centre of pressure's kernels, from what is not in question.

use faer::Mat;

use super::kernels::{COUNT, Sizes, WHITE, add_white, features, fixed_m2, unit_part};
use super::minimise::minimise;
use crate::block::Phase;
use crate::linear::{Factor, dot, outer};
use crate::rows::Rows;

/// What is believed before: 0.35°, 0.25° and 0.06° of wander, 3 % of soft tissue, 0.4 mm white, 3 mm per m/s, 1.5 mm of
/// pose, 0.9° of heading.
const BELIEVED: [f64; COUNT] = [0.0061, 0.0044, 0.00105, 0.03, 0.0004, 0.003, 0.0015, 0.0157];
/// How sure that is, as 1-σ of the logarithms.
const BELIEF_SIGMA: [f64; COUNT] = [0.3, 0.4, 0.8, 0.4, 0.6, 0.9, 0.5, 0.35];
/// Poses alone say little about motion and slow wander: then the belief counts for more.
const WITHOUT_REFERENCE: f64 = 0.5;
/// Blocks that the fit looks at: of poses and of clean work.
const FIT_MAX: [usize; 2] = [70, 150];
/// How wrong the inertia may be while the noise is fitted, as a share.
const INERTIA_SHARE: f64 = 0.2;

/// Logarithms of the sizes that fit best. `None` if the residuals are not numbers.
pub(crate) fn fit(rows: &Rows<'_>) -> Option<Sizes> {
    let has_reference = rows.blocks.iter().any(|block| block.phase == Phase::Reference);
    let strength = if has_reference { 1.0 } else { WITHOUT_REFERENCE };
    let sigma = BELIEF_SIGMA.map(|sigma| sigma * strength);
    let believed = BELIEVED.map(f64::ln);
    let some = rows.subset(&chosen(rows));
    if some.len() == 0 {
        return Some(believed);
    }
    let question = Question::of(&some);
    let least = std::array::from_fn(|i| believed[i] - 3.0 * sigma[i]);
    let most = std::array::from_fn(|i| believed[i] + 4.0 * sigma[i]);
    let curvature = sigma.map(|sigma| 1.0 / (sigma * sigma) + 10.0);
    minimise(believed, least, most, curvature, |sizes| {
        let (mut value, mut slope) = question.minus_log_likelihood(sizes)?;
        for i in 0..COUNT {
            let off = (sizes[i] - believed[i]) / sigma[i];
            value += 0.5 * off * off;
            slope[i] += off / sigma[i];
        }
        Some((value, slope))
    })
}

/// Poses and clean work, evenly.
fn chosen(rows: &Rows<'_>) -> Vec<usize> {
    let mut chosen = Vec::new();
    for (phase, most) in [Phase::Identify, Phase::Reference].into_iter().zip(FIT_MAX) {
        let all: Vec<usize> = (0..rows.len()).filter(|&i| rows.blocks[i].phase == phase).collect();
        let count = all.len().min(most);
        chosen.extend((0..count).map(|i| all[i * all.len() / count]));
    }
    chosen
}

/// Everything of the likelihood that does not depend on the sizes.
struct Question {
    fixed_m2: Mat<f64>,
    parts: Vec<Option<Mat<f64>>>,
    residual_m: Mat<f64>,
}

impl Question {
    fn of(rows: &Rows<'_>) -> Question {
        let inertia = features(rows, 1, |block, _| rows.inertia_m(block));
        let mut fixed_m2 = fixed_m2(rows);
        fixed_m2 += faer::Scale(INERTIA_SHARE * INERTIA_SHARE) * outer(inertia.as_ref(), inertia.as_ref());
        let mut residual_m = features(rows, 1, |block, _| rows.cop_residual_m(block));
        if !rows.session.has_inertia {
            residual_m -= inertia;
        }
        let parts = (0..COUNT).map(|part| (part != WHITE).then(|| unit_part(rows, part))).collect();
        Question { fixed_m2, parts, residual_m }
    }

    /// And its gradient over the logarithms of the sizes.
    fn minus_log_likelihood(&self, sizes: &Sizes) -> Option<(f64, [f64; COUNT])> {
        let mut covariance = self.fixed_m2.clone();
        for (part, &size) in self.parts.iter().zip(sizes) {
            if let Some(part) = part {
                covariance += faer::Scale((2.0 * size).exp()) * part;
            }
        }
        add_white(&mut covariance, sizes);
        let factor = Factor::of(&covariance)?;
        let mut weighted = self.residual_m.clone();
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

/// Sum over all elements of the products.
pub(super) fn all_products(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
    (0..a.ncols()).map(|j| dot(a.col_as_slice(j), b.col_as_slice(j))).sum()
}
