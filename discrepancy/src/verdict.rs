//! Compares the residual after the accepted effects with that of clean sessions; and the verdict.

use crate::block::Phase;
use crate::constants::{CLEAN_BOUNDS, NAMED_PROBABILITY, PIECE_BLOCKS_MIN, PIECES};
use crate::finding::Verdict;
use crate::floor::of_phase;
use crate::gram::Gram;
use crate::linear::dot;
use crate::select::Selection;

/// The whitened residual after all accepted effects, and its deviation from white noise.
#[derive(Debug, Clone)]
pub(crate) struct Remainder {
    /// Whitened residual before any effect.
    pub(crate) before: Vec<f64>,
    /// Whitened residual after the accepted effects.
    pub(crate) after: Vec<f64>,
    /// Mean square of the work's rows over that of the clean work's (at least 1): centre of pressure, vertical force.
    pub(crate) times_clean: [f64; 2],
    /// Correlation of one row of the centre of pressure with the next of its axis.
    pub(crate) correlation: f64,
    /// Worst piece of the work: how many σ its sum of squares exceeds its number of rows.
    pub(crate) worst_piece_sigma: f64,
}

impl Remainder {
    /// The residual after some accepted terms.
    pub(crate) fn of(gram: &Gram<'_>, accepted: &[usize]) -> Remainder {
        let (directions, mut after) = gram.directions_given(accepted);
        // Compute all inner products before any subtraction: the directions are not orthogonal.
        let along: Vec<f64> = directions.iter().map(|direction| dot(direction, &after)).collect();
        for (direction, along) in directions.iter().zip(along) {
            after.iter_mut().zip(direction).for_each(|(value, direction)| *value -= along * direction);
        }
        let times_clean = [0, 1].map(|channel| times_clean(gram, &after, channel));
        let correlation = correlation(gram, &after);
        let worst_piece_sigma = worst_piece_sigma(gram, &after);
        Remainder { before: gram.residual.clone(), after, times_clean, correlation, worst_piece_sigma }
    }

    /// Whether it exceeds the level of clean sessions.
    pub(crate) fn is_beyond_noise(&self) -> bool {
        let (squares, correlation, worst) = CLEAN_BOUNDS;
        self.times_clean.iter().zip(squares).any(|(times, bound)| *times > bound)
            || self.correlation > correlation
            || self.worst_piece_sigma > worst
    }
}

fn times_clean(gram: &Gram<'_>, after: &[f64], channel: usize) -> f64 {
    let mean = |blocks: &[usize]| {
        let squares: Vec<f64> = blocks
            .iter()
            .flat_map(|&block| rows_of(gram, block, channel))
            .map(|row| after[row] * after[row])
            .collect();
        (!squares.is_empty()).then(|| squares.iter().sum::<f64>() / squares.len() as f64)
    };
    let clean = mean(&of_phase(gram, Phase::Reference)).unwrap_or(1.0).max(1.0);
    mean(&of_phase(gram, Phase::Work)).unwrap_or(1.0) / clean
}

/// Rows of a block: of the centre of pressure (0), or of the vertical force (1).
pub(crate) fn rows_of(gram: &Gram<'_>, block: usize, channel: usize) -> Vec<usize> {
    match channel {
        0 => vec![2 * block, 2 * block + 1],
        _ => vec![gram.cop_rows() + block],
    }
}

fn correlation(gram: &Gram<'_>, after: &[f64]) -> f64 {
    let from = 2 * gram.rows.work_from;
    let rows = &after[from..gram.cop_rows()];
    let square = dot(rows, rows);
    if rows.len() < 4 || square <= 0.0 { 0.0 } else { dot(&rows[2..], rows) / square }
}

fn worst_piece_sigma(gram: &Gram<'_>, after: &[f64]) -> f64 {
    let work = of_phase(gram, Phase::Work);
    let length = work.len().div_ceil(PIECES).max(1);
    let of_piece = |piece: &[usize]| {
        let squares: Vec<f64> =
            piece.iter().flat_map(|&block| rows_of(gram, block, 0)).map(|row| after[row].powi(2)).collect();
        let count = squares.len() as f64;
        (squares.iter().sum::<f64>() - count) / (2.0 * count).sqrt()
    };
    work.chunks(length).filter(|piece| piece.len() >= PIECE_BLOCKS_MIN).map(of_piece).fold(0.0, f64::max)
}

/// The verdict.
pub(crate) fn verdict(selection: &Selection, rest: &Remainder) -> Verdict {
    if selection.is_outside {
        return Verdict::Unexplained;
    }
    match selection.accepted.first() {
        None if rest.is_beyond_noise() => Verdict::Unexplained,
        None => Verdict::None,
        Some(_) if selection.accepted.iter().any(|accepted| accepted.probability < NAMED_PROBABILITY) => {
            Verdict::Ambiguous
        }
        Some(_) => Verdict::Named,
    }
}
