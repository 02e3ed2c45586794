//! Candidate onsets and ends of effects in the work: an even grid, and the steps of the residual.

use crate::rows::Rows;

/// Pieces of the even grid.
const PIECES: usize = 24;
/// Maximum number of steps.
const LEAPS_MAX: usize = 8;
/// Blocks on each side of a step whose median counts, and blocks in between that are ignored: the onset of an effect
/// takes time.
const SIDE_BLOCKS: usize = 6;
const BETWEEN_BLOCKS: usize = 2;
/// Minimum size of a step: centre of pressure x and y, m, and vertical force, N.
const LEAST_M_M_N: [f64; 3] = [0.004, 0.004, 3.0];

/// Length of a piece of the even grid, s.
pub(crate) fn piece_s(rows: &Rows<'_>) -> f64 {
    let [from_s, to_s] = ends_s(rows);
    (to_s - from_s) / PIECES as f64
}

/// Start and end of the present work blocks, s.
pub(crate) fn ends_s(rows: &Rows<'_>) -> [f64; 2] {
    let half_s = 0.5 * rows.session.block_s;
    let from_s = if rows.work_from < rows.len() { rows.time_s(rows.work_from) - half_s } else { 0.0 };
    let to_s = if rows.len() > 0 { rows.time_s(rows.len() - 1) + half_s } else { 1.0 };
    [from_s, to_s]
}

/// All edges, s, ascending: a large effect fits only between its own edges.
pub(crate) fn edges_s(rows: &Rows<'_>) -> Vec<f64> {
    let [from_s, to_s] = ends_s(rows);
    let leaps_s = leaps_s(rows);
    let near = |at_s: f64| leaps_s.iter().any(|leap_s| (leap_s - at_s).abs() < 0.3 * piece_s(rows));
    let mut edges_s: Vec<f64> = (1..PIECES)
        .map(|piece| from_s + piece_s(rows) * piece as f64)
        .filter(|&at_s| !near(at_s))
        .chain(leaps_s.iter().copied())
        .chain([from_s, to_s])
        .collect();
    edges_s.sort_by(f64::total_cmp);
    edges_s
}

/// Largest steps of the residual, s; except at a change of stance.
fn leaps_s(rows: &Rows<'_>) -> Vec<f64> {
    let first = rows.work_from + SIDE_BLOCKS + BETWEEN_BLOCKS;
    let last = rows.len().saturating_sub(SIDE_BLOCKS + BETWEEN_BLOCKS);
    let mut leaps: Vec<(f64, usize)> = (first..last.max(first)).map(|at| (leap(rows, at), at)).collect();
    leaps.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<usize> = Vec::new();
    for (size, at) in leaps {
        if size < 1.0 || kept.len() == LEAPS_MAX {
            break;
        }
        if kept.iter().all(|&other| at.abs_diff(other) > SIDE_BLOCKS) {
            kept.push(at);
        }
    }
    kept.into_iter().map(|at| 0.5 * (rows.time_s(at - 1) + rows.time_s(at))).collect()
}

/// Size of the residual's step just before a block, over the examined channels.
fn leap(rows: &Rows<'_>, at: usize) -> f64 {
    let before = at - SIDE_BLOCKS - BETWEEN_BLOCKS..at - BETWEEN_BLOCKS;
    let after = at + BETWEEN_BLOCKS..at + BETWEEN_BLOCKS + SIDE_BLOCKS;
    let stands = rows.blocks[before.start].stance == rows.blocks[after.end - 1].stance;
    let value = |block: usize| {
        let [x, y] = rows.cop_residual_m(block);
        [x, y, rows.force_residual_n(block, 2)]
    };
    (0..3)
        .filter(|&signal| stands || signal == 2)
        .map(|signal| {
            let [before, after] =
                [before.clone(), after.clone()].map(|side| median(side.map(|block| value(block)[signal])));
            (after - before).abs() / LEAST_M_M_N[signal]
        })
        .fold(0.0, f64::max)
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
