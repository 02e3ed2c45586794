//! Compares the residual after the accepted effects with that of clean sessions; and the verdict.

use equipoise_core::effect::Effect;

use crate::block::Phase;
use crate::finding::Verdict;
use crate::floor::of_phase;
use crate::generic::Generics;
use crate::gram::Gram;
use crate::linear::dot;
use crate::select::{RIVAL, Selection};

/// Pieces of the work that are evaluated separately.
const PIECES: usize = 18;

/// The whitened residual after all accepted effects, and its deviation from white noise.
#[derive(Debug, Clone)]
pub(crate) struct Rest {
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

/// Clean sessions stay below these: mean squares, correlation, worst piece.
const BOUNDS: ([f64; 2], f64, f64) = ([2.0, 3.0], 0.35, 14.0);
/// A generic term must gain this much beyond the threshold, and this fraction of the explained evidence.
const GENERIC_GAIN: (f64, f64) = (4.0, 0.12);
/// A large effect always leaves a residual, since equations are not exact: less than this fraction of the explained
/// evidence is no further effect, even beyond noise.
const LEFT_SHARE: f64 = 0.04;
/// The same two fractions next to a push, which is never constant.
const OF_A_PUSH: [f64; 2] = [0.25, 0.2];
/// Generic terms alone must beat the catalogue by this much, or this fraction.
const GENERIC_LEAD: (f64, f64) = (8.0, 0.15);

impl Rest {
    /// The residual after some accepted terms.
    pub(crate) fn of(gram: &Gram<'_>, accepted: &[usize]) -> Rest {
        let (directions, mut after) = gram.directions_given(accepted);
        // Compute all inner products before any subtraction: the directions are not orthogonal.
        let along: Vec<f64> = directions.iter().map(|direction| dot(direction, &after)).collect();
        for (direction, along) in directions.iter().zip(along) {
            after.iter_mut().zip(direction).for_each(|(value, direction)| *value -= along * direction);
        }
        let times_clean = [0, 1].map(|channel| times_clean(gram, &after, channel));
        let correlation = correlation(gram, &after);
        let worst_piece_sigma = worst_piece_sigma(gram, &after);
        Rest { before: gram.residual.clone(), after, times_clean, correlation, worst_piece_sigma }
    }

    /// Whether it exceeds the level of clean sessions.
    pub(crate) fn is_beyond_noise(&self) -> bool {
        let (squares, correlation, worst) = BOUNDS;
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
    work.chunks(length).filter(|piece| piece.len() >= 5).map(of_piece).fold(0.0, f64::max)
}

/// The verdict.
pub(crate) fn verdict(selection: &Selection, generics: &Generics, rest: &Rest, threshold: f64) -> Verdict {
    let explained: f64 = selection.accepted.iter().map(|accepted| accepted.log_odds).sum();
    let left = generics.after.iter().map(|generic| generic.log_odds).fold(0.0, f64::max);
    let alone = generics.alone;
    let first = selection.accepted.iter().map(|accepted| accepted.log_odds).fold(0.0, f64::max);
    let lead = |named: f64| named + GENERIC_LEAD.0.max(GENERIC_LEAD.1 * named);
    // Several terms at once must exceed the threshold again; one unlike every catalogue effect already has.
    let outdone = alone > threshold + lead(explained) || generics.unlike > lead(first);
    let gain = if explained > 0.0 { GENERIC_GAIN.0 } else { 0.0 };
    let push = Effect::HandContact.name();
    let varies = selection.accepted.iter().any(|accepted| accepted.name.starts_with(push));
    let [of_more, of_left] = if varies { OF_A_PUSH } else { [GENERIC_GAIN.1, LEFT_SHARE] };
    let more = left > (threshold + gain).max(of_more * explained);
    if more || outdone || (rest.is_beyond_noise() && left > threshold.max(of_left * explained)) {
        return Verdict::Unexplained;
    }
    match selection.accepted.first() {
        None if rest.is_beyond_noise() => Verdict::Unexplained,
        None => Verdict::None,
        Some(_) if selection.accepted.iter().any(|accepted| !accepted.rivals().is_empty()) => {
            Verdict::Ambiguous
        }
        Some(_) => Verdict::Named,
    }
}

impl crate::select::Accepted {
    /// Effects that explain the data equally well, by name.
    pub(crate) fn rivals(&self) -> Vec<&crate::finding::Candidate> {
        let margin = RIVAL.0.max(RIVAL.1 * self.log_odds);
        self.considered
            .iter()
            .filter(|other| other.name != self.name && other.log_odds > self.log_odds - margin)
            .collect()
    }
}
