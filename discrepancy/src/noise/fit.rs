//! Sizes of the centre of pressure's kernels, fitted on the phases that are not in question.

use super::kernels::{COUNT, Sizes, WHITE, add_white, features, fixed_m2, unit_part};
use super::likelihood::{Belief, Question, chosen};
use crate::block::Phase;
use crate::linear::outer;
use crate::rows::Rows;

/// Prior: 0.35°, 0.25° and 0.06° of orientation drift, 3 % of soft tissue, 0.4 mm white, 3 mm per m/s, 1.5 mm of pose,
/// 0.9° of heading.
const BELIEVED: [f64; COUNT] = [0.0061, 0.0044, 0.00105, 0.03, 0.0004, 0.003, 0.0015, 0.0157];
/// Prior 1-σ of the logarithms.
const BELIEF_SIGMA: [f64; COUNT] = [0.3, 0.4, 0.8, 0.4, 0.6, 0.9, 0.5, 0.35];
/// Poses alone carry little information about motion and slow drift: the prior then has more weight.
const WITHOUT_REFERENCE: f64 = 0.5;
/// Relative error of the inertia assumed while the noise is fitted.
const INERTIA_SHARE: f64 = 0.2;

/// Logarithms of the best sizes. `None` if the residuals are not finite.
pub(crate) fn fit(rows: &Rows<'_>) -> Option<Sizes> {
    let has_reference = rows.blocks.iter().any(|block| block.phase == Phase::Reference);
    let strength = if has_reference { 1.0 } else { WITHOUT_REFERENCE };
    let sigma = BELIEF_SIGMA.map(|sigma| sigma * strength);
    let believed = BELIEVED.map(f64::ln);
    let some = rows.subset(&chosen(rows));
    if some.len() == 0 {
        return Some(believed);
    }
    question(&some).likeliest(&Belief {
        mean: believed,
        sigma,
        least: std::array::from_fn(|i| believed[i] - 3.0 * sigma[i]),
        most: std::array::from_fn(|i| believed[i] + 4.0 * sigma[i]),
    })
}

fn question(rows: &Rows<'_>) -> Question<COUNT> {
    let inertia = features(rows, 1, |block, _| rows.inertia_m(block));
    let mut fixed = fixed_m2(rows);
    fixed += faer::Scale(INERTIA_SHARE * INERTIA_SHARE) * outer(inertia.as_ref(), inertia.as_ref());
    let mut residual = features(rows, 1, |block, _| rows.cop_residual_m(block));
    if !rows.session.has_inertia {
        residual -= inertia;
    }
    let parts = std::array::from_fn(|part| (part != WHITE).then(|| unit_part(rows, part)));
    Question { fixed, parts, residual, add_white }
}
