//! Steps of the residual: where an effect begins, ends or changes at once.

use crate::block::Block;
use crate::constants::{STEP_BLOCKS, STEP_MIN, STEPS_MAX};

/// Largest steps of the residual in successive blocks, s, at least this size over [`STEP_MIN`]; except at a change of
/// stance.
pub(crate) fn steps_s(blocks: &[&Block], min: f64) -> Vec<f64> {
    let (side, ignored) = STEP_BLOCKS;
    let reach = side + ignored;
    let last = blocks.len().saturating_sub(reach);
    let mut steps: Vec<(f64, usize)> =
        (reach..last.max(reach)).map(|at| (step_size(blocks, at), at)).collect();
    steps.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<usize> = Vec::new();
    for (size, at) in steps {
        if size < min || kept.len() == STEPS_MAX {
            break;
        }
        if kept.iter().all(|&other| at.abs_diff(other) > side) {
            kept.push(at);
        }
    }
    let time_s = |at: usize| blocks[at].observation.time_s;
    kept.into_iter().map(|at| 0.5 * (time_s(at - 1) + time_s(at))).collect()
}

/// Size of the residual's step just before a block, in units of [`STEP_MIN`]: the largest of the channels.
fn step_size(blocks: &[&Block], at: usize) -> f64 {
    let (side, ignored) = STEP_BLOCKS;
    let before = &blocks[at - side - ignored..at - ignored];
    let after = &blocks[at + ignored..at + ignored + side];
    let same_stance = before[0].stance == after[side - 1].stance;
    (0..3)
        .filter(|&signal| same_stance || signal == 2)
        .map(|signal| {
            let [before, after] = [before, after].map(|blocks| median(blocks, signal));
            (after - before).abs() / STEP_MIN[signal]
        })
        .fold(0.0, f64::max)
}

/// Median of a residual: centre of pressure x, y, m; vertical force, N.
fn median(blocks: &[&Block], signal: usize) -> f64 {
    let mut values: Vec<f64> = blocks
        .iter()
        .map(|block| {
            let seen = &block.observation;
            match signal {
                2 => seen.force_measured_n[2] - seen.force_predicted_n[2],
                axis => seen.cop_measured_m[axis] - seen.cop_predicted_m[axis],
            }
        })
        .collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
