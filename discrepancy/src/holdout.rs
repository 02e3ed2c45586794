//! Gap between model and measurement before and after, by cross-validation: parameters from four fifths of the work's
//! intervals, the gap on the remaining fifth.

use nalgebra::DMatrix;

use crate::constants::{FOLDS, INTERVALS_PER_FOLD};
use crate::evidence::estimate;
use crate::gram::Gram;
use crate::linear::{self, Factor, dot, inner};
use crate::rows::Rows;

/// Residuals of the work, by block: x, y (m), vertical (N); minus the stance offset, and finally minus the expectation
/// conditioned on the clean rows.
#[derive(Debug, Clone)]
pub(crate) struct HeldOut {
    /// With the original model.
    pub(crate) before: Vec<[f64; 3]>,
    /// With the named effects, by parameters from the other folds.
    pub(crate) after: Vec<[f64; 3]>,
    /// Prediction of each accepted term, by parameters from the other folds.
    pub(crate) of_term: Vec<Vec<[f64; 3]>>,
}

impl HeldOut {
    /// Subtracts the expectation of each block of the work, before and after, conditioned on the clean rows, m, m, N:
    /// earlier errors of the subject's parameters and of the pose then do not contribute to the gap.
    pub(crate) fn subtract_expected(&mut self, expected: &[Vec<[f64; 3]>; 2]) {
        for (list, expected) in [&mut self.before, &mut self.after].into_iter().zip(expected) {
            for (residual, mean) in list.iter_mut().zip(expected) {
                residual.iter_mut().zip(mean).for_each(|(residual, mean)| *residual -= mean);
            }
        }
    }
}

/// Fold of each block of the work. Folds consist of intervals, not of blocks, since neighbours share their noise.
fn folds(rows: &Rows<'_>) -> Vec<usize> {
    let work = rows.work_from..rows.len();
    let Some(first_s) = work.clone().next().map(|block| rows.time_s(block)) else { return Vec::new() };
    let length_s = rows.time_s(rows.len() - 1) - first_s + 1e-6;
    work.map(|block| {
        let interval = (rows.time_s(block) - first_s) / length_s * (FOLDS * INTERVALS_PER_FOLD) as f64;
        interval as usize % FOLDS
    })
    .collect()
}

/// Subtracts the named effects. `None` where the algebra fails.
pub(crate) fn held_out(gram: &Gram<'_>, accepted: &[usize], stances_m: &[[f64; 2]]) -> Option<HeldOut> {
    let rows = gram.rows;
    let before: Vec<[f64; 3]> = (rows.work_from..rows.len())
        .map(|block| {
            let [x, y] = rows.cop_residual_m(block);
            [x - stances_m[block][0], y - stances_m[block][1], rows.force_residual_n(block, 2)]
        })
        .collect();
    let mut held = HeldOut {
        after: before.clone(),
        of_term: vec![vec![[0.0; 3]; before.len()]; accepted.len()],
        before,
    };
    if accepted.is_empty() {
        return Some(held);
    }
    let folds = folds(rows);
    for fold in 0..FOLDS {
        let blocks: Vec<usize> =
            (0..folds.len()).filter(|&i| folds[i] == fold).map(|i| i + rows.work_from).collect();
        if blocks.is_empty() {
            continue;
        }
        let value = estimate_without(gram, accepted, &blocks)?;
        for &block in &blocks {
            subtract_prediction(gram, accepted, &value, block, &mut held);
        }
    }
    Some(held)
}

/// Parameters without these blocks: their rows get infinite noise. Errors of the sensors are fitted as well.
fn estimate_without(gram: &Gram<'_>, accepted: &[usize], blocks: &[usize]) -> Option<Vec<f64>> {
    let of_terms = gram.columns_of(accepted);
    let (mut mean, mut sigma) = gram.priors(accepted);
    let own = of_terms.iter().map(|&column| &gram.columns[column]);
    let columns: Vec<&[f64]> = own.chain(&gram.sensor_errors).map(Vec::as_slice).collect();
    mean.resize(columns.len(), 0.0);
    sigma.resize(columns.len(), 1.0);
    let held_out = held_out_directions(gram, blocks)?;
    let along = |column: &[f64]| -> Vec<f64> {
        held_out
            .iter()
            .flat_map(|(from, part)| {
                let rows = part.nrows();
                let column = &column[*from..from + rows];
                (0..part.ncols()).map(|j| dot(linear::column(part, j), column)).collect::<Vec<_>>()
            })
            .collect()
    };
    let along_columns: Vec<Vec<f64>> = columns.iter().map(|&column| along(column)).collect();
    let residual = along(&gram.residual);
    // Without the marginalised directions, which are not orthogonal to those of the left-out blocks.
    let products =
        |i: usize, j: usize| dot(columns[i], columns[j]) - dot(&along_columns[i], &along_columns[j]);
    let with_residual = |i: usize| dot(columns[i], &gram.residual) - dot(&along_columns[i], &residual);
    let mut value = estimate(&products, &with_residual, &mean, &sigma)?.value;
    value.truncate(of_terms.len());
    Some(value)
}

/// Orthonormal directions of the whitened rows that these blocks span, per channel: first row, and directions.
fn held_out_directions(gram: &Gram<'_>, blocks: &[usize]) -> Option<Vec<(usize, DMatrix<f64>)>> {
    let count = gram.rows.len();
    let first = blocks[0];
    let mut parts = Vec::new();
    let mut channel = |factor: &Factor, rows: Vec<usize>, from_row: usize, offset: usize| {
        let mut units = DMatrix::zeros(factor.len() - from_row, rows.len());
        for (column, row) in rows.iter().enumerate() {
            units[(row - from_row, column)] = 1.0;
        }
        factor.whiten_from(from_row, &mut units);
        let square = inner(&units, &units);
        let root = Factor::of(&square)?;
        let mut transposed = units.transpose();
        root.whiten_from(0, &mut transposed);
        parts.push((offset + from_row, transposed.transpose()));
        Some(())
    };
    let cop_rows = blocks.iter().flat_map(|&block| [2 * block, 2 * block + 1]).collect();
    channel(&gram.noise.cop, cop_rows, 2 * first, 0)?;
    for (index, factor) in gram.noise.force.iter().enumerate() {
        channel(factor, blocks.to_vec(), first, (2 + index) * count)?;
    }
    Some(parts)
}

/// Subtracts the prediction of the accepted terms at a block.
fn subtract_prediction(gram: &Gram<'_>, accepted: &[usize], value: &[f64], block: usize, held: &mut HeldOut) {
    let row = block - gram.rows.work_from;
    for (index, predicted) in gram.predictions(accepted, value, block).enumerate() {
        held.of_term[index][row] = predicted;
        held.after[row].iter_mut().zip(predicted).for_each(|(after, part)| *after -= part);
    }
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::Side;
    use equipoise_core::effect::{Effect, Place};

    use super::*;
    use crate::candidate::{Candidate, Scope};
    use crate::noise::Noise;
    use crate::support::{END_S, REFERENCE_S, clean, hide};

    #[test]
    fn an_error_of_the_sensors_does_not_bias_the_parameters_without_some_blocks() {
        let mut session = clean(5);
        let hand = Place::Hand(Side::Right);
        hide(&mut session, Effect::HandLoad, hand, &[1.0], [REFERENCE_S, END_S]);
        hide(&mut session, Effect::ForceGain, Place::Whole, &[0.1], [REFERENCE_S, END_S]);
        let all = Rows::of(&session);
        let rows = all.subset(&(0..all.len()).step_by(5).collect::<Vec<usize>>());
        let noise = Noise::fit(&rows).unwrap();
        let mut gram = Gram::of(&rows, &noise, Vec::new());
        let gain = Candidate::new(Effect::ForceGain, Place::Whole, 0.0, Scope::Work);
        for column in gram.whitened(gain.count(), |block| gain.columns(&rows, block)) {
            gram.marginalise_sensor_error(&column, 0.1);
        }
        let term = gram.add_candidate(Candidate::new(Effect::HandLoad, hand, 0.0, Scope::Work));
        let all_blocks = gram.estimate(&[term]).unwrap();
        let value = estimate_without(&gram, &[term], &[rows.work_from + 5]).unwrap();
        assert_eq!(value.len(), all_blocks.value.len());
        let off_kg = (value[0] - all_blocks.value[0]).abs();
        assert!(off_kg < all_blocks.sigma[0], "{value:?} instead of {all_blocks:?}");
    }
}
