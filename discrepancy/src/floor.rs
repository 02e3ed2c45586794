//! Expected deviation by noise alone in the work phase, conditioned on the clean rows.

use faer::Mat;

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
        let before = Floor::expected(gram, stances_m, |_| [0.0; 3]);
        let explained = |block: usize| {
            gram.predictions(accepted, &value, block)
                .fold([0.0; 3], |sum, predicted| [0, 1, 2].map(|signal| sum[signal] + predicted[signal]))
        };
        let after = Floor::expected(gram, stances_m, explained);
        let [mean, sigma] = before;
        Some(Floor { mean: [mean, after.into_iter().next()?], sigma })
    }

    /// Expectation and 1-σ of the residual minus its `explained` part, m, m, N. The clean rows come first, so the
    /// factor already contains both results: with `L = [A 0; B C]`, the mean is `B` times the whitened clean rows, the
    /// covariance `C Cᵀ`.
    fn expected(
        gram: &Gram<'_>,
        stances_m: &[[f64; 2]],
        explained: impl Fn(usize) -> [f64; 3],
    ) -> [Vec<[f64; 3]>; 2] {
        let rows = gram.rows;
        let (work, from) = (rows.len() - rows.work_from, rows.work_from);
        let without = &gram.noise.cop_without_stances;
        let mut residual_m = cop_columns(rows, 1, |block, _| {
            let (residual_m, explained) = (rows.cop_residual_m(block), explained(block));
            [0, 1].map(|axis| residual_m[axis] - stances_m[block][axis] - explained[axis])
        });
        without.whiten_from(0, &mut residual_m);
        let vertical = gram.noise.force.first().map(|factor| {
            let residual_n = |block, _| rows.force_residual_n(block, 2) - explained(block)[2];
            let mut residual_n = Mat::from_fn(rows.len(), 1, residual_n);
            factor.whiten_from(0, &mut residual_n);
            (factor, residual_n)
        });
        let (mut mean, mut sigma) = (vec![[0.0; 3]; work], vec![[0.0; 3]; work]);
        for block in 0..work {
            for axis in 0..2 {
                let row = 2 * (from + block) + axis;
                (mean[block][axis], sigma[block][axis]) =
                    predicted(without, row, 2 * from, residual_m.col_as_slice(0));
            }
            if let Some((factor, residual_n)) = &vertical {
                (mean[block][2], sigma[block][2]) =
                    predicted(factor, from + block, from, residual_n.col_as_slice(0));
            }
        }
        [mean, sigma]
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
    let mut weighted = Mat::from_fn(count, 1, |row, _| after[row]);
    gram.noise.cop.solve_transposed(&mut weighted);
    let offset_m = product(gram.noise.stances_m2.as_ref(), weighted.as_ref());
    (0..gram.rows.len()).map(|block| [offset_m[(2 * block, 0)], offset_m[(2 * block + 1, 0)]]).collect()
}

fn predicted(factor: &Factor, row: usize, clean: usize, whitened: &[f64]) -> (f64, f64) {
    let lower = factor.lower();
    let mean = (0..clean).map(|column| lower[(row, column)] * whitened[column]).sum();
    let square: f64 = (clean..=row).map(|column| lower[(row, column)].powi(2)).sum();
    (mean, square.sqrt())
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
