//! Expected deviation by noise alone in the work phase, conditioned on the clean rows.

use nalgebra::DMatrix;

use crate::block::Phase;
use crate::gram::Gram;
use crate::linear::{Factor, product};
use crate::noise::cop::cop_columns;

/// Expected residual of every block of the work and its 1-σ: centre of pressure x, y (m), vertical force (N).
#[derive(Debug, Clone)]
pub(crate) struct Floor {
    /// Expectation (m, m, N) conditioned on the clean rows, with the original model and with the accepted terms.
    pub(crate) mean: [Vec<[f64; 3]>; 2],
    /// 1-σ of noise around that expectation.
    pub(crate) sigma: Vec<[f64; 3]>,
}

impl Floor {
    /// Expectation and σ of all work rows, given the stance offsets; `None` if the terms cannot be estimated.
    pub(crate) fn of(gram: &Gram<'_>, accepted: &[usize], stances_m: &[[f64; 2]]) -> Option<Floor> {
        let value = if accepted.is_empty() { Vec::new() } else { gram.estimate(accepted)?.value };
        let explained = |block: usize| {
            gram.predictions(accepted, &value, block)
                .fold([0.0; 3], |sum, predicted| [0, 1, 2].map(|signal| sum[signal] + predicted[signal]))
        };
        let before = mean(gram, stances_m, |_| [0.0; 3]);
        Some(Floor { mean: [before, mean(gram, stances_m, explained)], sigma: sigma(gram) })
    }

    /// Root mean square deviation of noise alone on one axis from the expectation conditioned on the clean rows, over
    /// some blocks of the work.
    pub(crate) fn root_mean_square(&self, axis: usize, of: impl Fn(usize) -> bool) -> f64 {
        let some = (0..self.sigma.len()).filter(|&block| of(block));
        root_mean(some.map(|block| self.sigma[block][axis].powi(2)))
    }
}

/// Stance offset of each block, m, estimated from all data once some terms are accepted. No model can predict it, so it
/// counts on neither side of the gap.
pub(crate) fn stances_m(gram: &Gram<'_>, after: &[f64]) -> Vec<[f64; 2]> {
    let count = gram.cop_rows();
    let mut weighted = DMatrix::from_fn(count, 1, |row, _| after[row]);
    gram.noise.cop.solve_transposed(&mut weighted);
    let offset_m = product(&gram.noise.stances_m2, &weighted);
    (0..gram.rows.len()).map(|block| [offset_m[(2 * block, 0)], offset_m[(2 * block + 1, 0)]]).collect()
}

// The clean rows come first, so the factor `L = [A 0; B C]` of all rows already contains expectation and covariance given
// the clean rows: `B` times the whitened clean rows, and `C Cᵀ`.

/// Expectation of the residual minus its `explained` part in the work, m, m, N.
fn mean(gram: &Gram<'_>, stances_m: &[[f64; 2]], explained: impl Fn(usize) -> [f64; 3]) -> Vec<[f64; 3]> {
    let (rows, from) = (gram.rows, gram.rows.work_from);
    let cop = &gram.noise.cop_without_stances;
    let mut residual_m = cop_columns(rows, 1, |block, _| {
        let (residual_m, explained) = (rows.cop_residual_m(block), explained(block));
        [0, 1].map(|axis| residual_m[axis] - stances_m[block][axis] - explained[axis])
    });
    cop.whiten_from(0, &mut residual_m);
    let vertical = gram.noise.force.first().map(|factor| {
        let residual_n = |block, _| rows.force_residual_n(block, 2) - explained(block)[2];
        let mut residual_n = DMatrix::from_fn(rows.len(), 1, residual_n);
        factor.whiten_from(0, &mut residual_n);
        (factor, residual_n)
    });
    let given_clean = |factor: &Factor, row: usize, clean: usize, whitened: &DMatrix<f64>| -> f64 {
        (0..clean).map(|column| factor.lower()[(row, column)] * whitened[(column, 0)]).sum()
    };
    let of_block = |block: usize| {
        let of_axis = |axis: usize| given_clean(cop, 2 * block + axis, 2 * from, &residual_m);
        let of_vertical =
            |(factor, residual_n): &(&Factor, DMatrix<f64>)| given_clean(factor, block, from, residual_n);
        [of_axis(0), of_axis(1), vertical.as_ref().map_or(0.0, of_vertical)]
    };
    (from..rows.len()).map(of_block).collect()
}

/// 1-σ of the residual in the work around any such expectation, m, m, N.
fn sigma(gram: &Gram<'_>) -> Vec<[f64; 3]> {
    let from = gram.rows.work_from;
    let given_clean = |factor: &Factor, row: usize, clean: usize| {
        (clean..=row).map(|column| factor.lower()[(row, column)].powi(2)).sum::<f64>().sqrt()
    };
    let of_block = |block: usize| {
        let of_axis = |axis: usize| given_clean(&gram.noise.cop_without_stances, 2 * block + axis, 2 * from);
        let vertical = gram.noise.force.first();
        [of_axis(0), of_axis(1), vertical.map_or(0.0, |factor| given_clean(factor, block, from))]
    };
    (from..gram.rows.len()).map(of_block).collect()
}

/// Square root of the mean; 0 for an empty input.
pub(crate) fn root_mean(squares: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = squares.fold((0.0, 0_u32), |(sum, count), square| (sum + square, count + 1));
    if count == 0 { 0.0 } else { (sum / f64::from(count)).sqrt() }
}

/// The blocks of one phase, by row.
pub(crate) fn of_phase(gram: &Gram<'_>, phase: Phase) -> Vec<usize> {
    (0..gram.rows.len()).filter(|&block| gram.rows.blocks[block].phase == phase).collect()
}

#[cfg(test)]
mod tests {
    use equipoise_core::effect::{Effect, Place};

    use super::*;
    use crate::candidate::{Candidate, Scope};
    use crate::linear::outer;
    use crate::noise::Noise;
    use crate::rows::Rows;
    use crate::support::{END_S, REFERENCE_S, clean, hide};

    #[test]
    fn mean_and_sigma_are_those_of_the_noise_given_the_clean_rows() {
        let mut session = clean(5);
        hide(&mut session, Effect::PlateOffset, Place::Whole, &[0.03, 0.0], [REFERENCE_S, END_S]);
        let all = Rows::of(&session);
        let rows = all.subset(&(0..all.len()).step_by(5).collect::<Vec<usize>>());
        let noise = Noise::fit(&rows).unwrap();
        let mut gram = Gram::of(&rows, &noise, Vec::new());
        let term = gram.add_candidate(Candidate::new(Effect::PlateOffset, Place::Whole, 0.0, Scope::Work));
        let stances_m = vec![[0.0; 2]; rows.len()];
        let floor = Floor::of(&gram, &[term], &stances_m).unwrap();
        let factor = noise.cop_without_stances.lower();
        let covariance = outer(factor, factor);
        let (from, work) = (rows.work_from, rows.len() - rows.work_from);
        let clean_rows = 2 * from;
        let inverse =
            Factor::of(&covariance.view((0, 0), (clean_rows, clean_rows)).into_owned()).unwrap().inverse();
        for block in [0, work / 2, work - 1] {
            let row = 2 * (from + block);
            let with_clean = DMatrix::from_fn(1, clean_rows, |_, column| covariance[(row, column)]);
            let gain = &with_clean * &inverse;
            let residual_m =
                DMatrix::from_fn(clean_rows, 1, |other, _| rows.cop_residual_m(other / 2)[other % 2]);
            let mean_m = (&gain * &residual_m)[(0, 0)];
            let variance_m2 = covariance[(row, row)] - (&gain * with_clean.transpose())[(0, 0)];
            let sigma_m = floor.sigma[block][0];
            assert!(
                (sigma_m - variance_m2.sqrt()).abs() < 1e-9,
                "{sigma_m} instead of {}",
                variance_m2.sqrt()
            );
            // The effect acts in the work only, so the clean rows expect the same with and without it.
            for of_model in &floor.mean {
                assert!(
                    (of_model[block][0] - mean_m).abs() < 1e-9,
                    "{} instead of {mean_m}",
                    of_model[block][0]
                );
            }
        }
    }
}
