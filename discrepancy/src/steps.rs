//! Steps of the residual: where an effect begins, ends or changes at once.

use crate::block::Block;
use crate::constants::{STEP_BLOCKS, STEP_MIN, STEPS_MAX};

/// Largest steps of the residual in successive blocks, s, at least this size over [`STEP_MIN`]; except at a change of
/// stance.
pub(crate) fn steps_s(blocks: &[&Block], min: f64) -> Vec<f64> {
    let (side, ignored) = STEP_BLOCKS;
    let reach = side + ignored;
    let last = blocks.len().saturating_sub(reach);
    let size = |at: usize| step_size(blocks, [at - ignored, at + ignored], median);
    let mut steps: Vec<(f64, usize)> = (reach..last.max(reach)).map(|at| (size(at), at)).collect();
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
    // Medians show a step equally at neighbouring blocks; means are largest at the step itself.
    let contrast = |at: &usize| step_size(blocks, [*at; 2], mean);
    let exact = |at: usize| {
        let near = (at - ignored).max(side)..=(at + ignored).min(blocks.len() - side);
        near.max_by(|a, b| contrast(a).total_cmp(&contrast(b))).unwrap_or(at)
    };
    let time_s = |at: usize| blocks[at].observation.time_s;
    kept.into_iter().map(exact).map(|at| 0.5 * (time_s(at - 1) + time_s(at))).collect()
}

/// Difference between the blocks before one and those from another one on, in units of [`STEP_MIN`]: the largest of the
/// channels.
fn step_size(blocks: &[&Block], [end, begin]: [usize; 2], average: fn(&[&Block], usize) -> f64) -> f64 {
    let (side, _) = STEP_BLOCKS;
    let (before, after) = (&blocks[end - side..end], &blocks[begin..begin + side]);
    let same_stance = before[0].stance == after[side - 1].stance;
    (0..3)
        .filter(|&signal| same_stance || signal == 2)
        .map(|signal| (average(after, signal) - average(before, signal)).abs() / STEP_MIN[signal])
        .fold(0.0, f64::max)
}

/// A residual of a block: centre of pressure x, y, m; vertical force, N.
fn residual(block: &Block, signal: usize) -> f64 {
    let seen = &block.observation;
    match signal {
        2 => seen.force_measured_n[2] - seen.force_predicted_n[2],
        axis => seen.cop_measured_m[axis] - seen.cop_predicted_m[axis],
    }
}

/// Mean of a residual.
fn mean(blocks: &[&Block], signal: usize) -> f64 {
    blocks.iter().map(|block| residual(block, signal)).sum::<f64>() / blocks.len() as f64
}

/// Median of a residual.
fn median(blocks: &[&Block], signal: usize) -> f64 {
    let mut values: Vec<f64> = blocks.iter().map(|block| residual(block, signal)).collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
