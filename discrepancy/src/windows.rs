//! Temporary effects: all pairs of onset and end over some two dozen pieces of the work, by cumulative sums of the
//! pieces' inner products; then the edges to a second.

use equipoise_core::body::Segment;
use equipoise_core::effect::{Columns, Effect, Place};
use nalgebra::DMatrix;

use crate::candidate::{Candidate, Scope, place_log_prior};
use crate::constants::{
    EDGE_PIECES, EDGE_STEP_MIN_S, INTERVAL_MIN_S, PART_CUTOFFS_HZ, PART_LAGS_S, PART_MODEL_ERROR,
    PART_MODEL_ERROR_OF_SAME, STEP_BLOCKS, STEP_MIN, STEP_REPLACES, STEPS_MAX, TIMING_PART_MIN_S,
};
use crate::evidence::log_odds;
use crate::gram::Gram;
use crate::linear::{dot, inner};
use crate::rows::Rows;

/// An effect in the best-fitting part of the work.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// The effect with that time span.
    pub(crate) candidate: Candidate,
    /// Log Bayes factor, including the penalty for the number of parts.
    pub(crate) log_odds: f64,
    /// The same if the effect is certain and only its time span is in question.
    pub(crate) log_odds_of_same: f64,
    /// Log Bayes factor of the effect in the whole work.
    pub(crate) log_odds_of_whole: f64,
}

/// One candidate, whitened piece by piece.
struct Pieces {
    candidate: Candidate,
    columns: DMatrix<f64>,
    products: DMatrix<f64>,
}

/// All temporary candidates, prepared for repeated searches.
pub(crate) struct Windows {
    edges_s: Vec<f64>,
    pieces: Vec<Pieces>,
}

/// Candidates that may act in parts of the work: loads put on or taken up, contacts, knocked sensors and disturbances,
/// above the legs.
fn can_be_temporary(candidate: &Candidate) -> bool {
    let is_above_the_legs = match candidate.place {
        Place::Segment(segment) => segment == Segment::Pelvis || segment.is_distal_to(Segment::T8),
        _ => true,
    };
    match candidate.effect {
        Effect::WornMass => true,
        Effect::SuitLag => PART_LAGS_S.contains(&candidate.shape),
        Effect::PlateLowpass => PART_CUTOFFS_HZ.contains(&candidate.shape),
        Effect::PlateDrift | Effect::SuitHeadingDrift | Effect::PeriodicSway | Effect::Inertia => false,
        _ => is_above_the_legs,
    }
}

/// Shortest part of the work in which an effect may act, s; timing effects are observable only in motion.
pub(crate) fn shortest_s(effect: Effect) -> f64 {
    match effect {
        Effect::SuitLag | Effect::PlateLowpass => TIMING_PART_MIN_S,
        _ => INTERVAL_MIN_S,
    }
}

/// Number of shapes that are tried in parts of the work.
fn shapes_in_parts(effect: Effect) -> f64 {
    match effect {
        Effect::SuitLag => PART_LAGS_S.len() as f64,
        Effect::PlateLowpass => PART_CUTOFFS_HZ.len() as f64,
        _ => 1.0,
    }
}

impl Windows {
    /// Prepares the candidates that may be temporary.
    pub(crate) fn of(gram: &Gram<'_>) -> Windows {
        let edges_s = edges_s(gram.rows);
        let pieces = gram
            .terms
            .iter()
            .filter_map(|term| term.candidate.as_ref())
            .filter(|candidate| candidate.scope == Scope::Work && can_be_temporary(candidate))
            .filter(|candidate| candidate.about.iter().all(|&about| about == 0.0))
            .map(|candidate| Pieces::of(gram, candidate, &edges_s))
            .collect();
        Windows { edges_s, pieces }
    }

    /// The best part for each candidate, conditioned on the accepted terms; best first.
    pub(crate) fn best(&self, gram: &Gram<'_>, accepted: &[usize]) -> Vec<Part> {
        let (directions, residual) = gram.directions_given(accepted);
        let others = DMatrix::from_fn(residual.len(), directions.len() + 1, |row, column| {
            directions.get(column).map_or(residual[row], |direction| direction[row])
        });
        let on_residual: Vec<f64> = directions.iter().map(|direction| dot(direction, &residual)).collect();
        let mut parts: Vec<Part> =
            self.pieces.iter().filter_map(|pieces| self.best_part(pieces, &others, &on_residual)).collect();
        parts.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
        parts
    }

    /// The best part of a candidate. `others`: the directions to be projected out, then the residual.
    fn best_part(&self, pieces: &Pieces, others: &DMatrix<f64>, on_residual: &[f64]) -> Option<Part> {
        let count = pieces.candidate.count();
        let (with_others, directions) = (inner(&pieces.columns, others), on_residual.len());
        let along: Vec<Vec<f64>> = (0..pieces.columns.ncols())
            .map(|column| (0..directions).map(|direction| with_others[(column, direction)]).collect())
            .collect();
        let with_residual: Vec<f64> = along
            .iter()
            .enumerate()
            .map(|(column, along)| with_others[(column, directions)] - dot(along, on_residual))
            .collect();
        let sums = Sums::of(pieces, &along, &with_residual, count);
        let (mean, sigma) = (&pieces.candidate.mean, &pieces.candidate.sigma);
        let last = self.edges_s.len() - 1;
        let score = |from: usize, to: usize| {
            log_odds(&|i, j| sums.product(from, to, i, j), &|i| sums.with_residual(from, to, i), mean, sigma)
        };
        let log_odds_of_whole = score(0, last);
        let length_s = |from: usize, to: usize| self.edges_s[to] - self.edges_s[from];
        let shortest_s = shortest_s(pieces.candidate.effect).min(length_s(0, last));
        let pairs = (0..last)
            .flat_map(|from| (from + 1..=last).map(move |to| (from, to)))
            .filter(|&(from, to)| length_s(from, to) >= shortest_s);
        let (from, to, best) =
            pairs.map(|(from, to)| (from, to, score(from, to))).max_by(|a, b| a.2.total_cmp(&b.2))?;
        let parts = (last * (last + 1) / 2) as f64;
        let penalty = parts.ln() + 2.0_f64.ln() + shapes_in_parts(pieces.candidate.effect).ln()
            - place_log_prior(pieces.candidate.effect, pieces.candidate.place);
        let log_odds_of_same = best - penalty - PART_MODEL_ERROR_OF_SAME * best.max(0.0);
        let log_odds = best - penalty - PART_MODEL_ERROR * best.max(0.0);
        let scope = Scope::Span([self.edges_s[from], self.edges_s[to]]);
        let candidate = Candidate { scope, log_prior: -penalty, ..pieces.candidate.clone() };
        Some(Part { candidate, log_odds, log_odds_of_same, log_odds_of_whole })
    }
}

/// Moves both edges of a part as long as the evidence increases; the resolution is a block.
pub(crate) fn refine(gram: &Gram<'_>, candidate: &Candidate, accepted: &[usize]) -> Candidate {
    let Scope::Span(mut span_s) = candidate.scope else { return candidate.clone() };
    let (directions, residual) = gram.directions_given(accepted);
    let [min_s, max_s] = ends_s(gram.rows);
    let score = |span_s: [f64; 2]| {
        let candidate = Candidate { scope: Scope::Span(span_s), ..candidate.clone() };
        gram.score_candidate(&candidate, &directions, &residual)
    };
    let mut best = score(span_s);
    let shortest_s = shortest_s(candidate.effect).min(span_s[1] - span_s[0]);
    let mut step_s = 0.5 * piece_s(gram.rows);
    while step_s > EDGE_STEP_MIN_S {
        let moves = [[step_s, 0.0], [-step_s, 0.0], [0.0, step_s], [0.0, -step_s]];
        let better = moves.into_iter().find_map(|[from, to]| {
            let moved = [(span_s[0] + from).max(min_s), (span_s[1] + to).min(max_s)];
            let value = if moved[1] - moved[0] < shortest_s { f64::NEG_INFINITY } else { score(moved) };
            (value > best + 1e-6).then_some((moved, value))
        });
        match better {
            Some((moved, value)) => (span_s, best) = (moved, value),
            None => step_s *= 0.5,
        }
    }
    Candidate { scope: Scope::Span(span_s), ..candidate.clone() }
}

/// A mass without its exact position, since a part is short.
fn without_moment(candidate: &Candidate) -> Candidate {
    let mut simple = candidate.clone();
    let is_trunk = matches!(candidate.place, Place::Segment(Segment::T8 | Segment::Pelvis));
    if candidate.effect == Effect::HandLoad || (candidate.effect == Effect::WornMass && !is_trunk) {
        simple.mean.truncate(1);
        simple.sigma.truncate(1);
    }
    simple
}

impl Pieces {
    fn of(gram: &Gram<'_>, candidate: &Candidate, edges_s: &[f64]) -> Pieces {
        let candidate = without_moment(candidate);
        let count = candidate.count();
        let mut columns = Vec::new();
        for edge in edges_s.windows(2) {
            let piece = Candidate { scope: Scope::Work, ..candidate.clone() };
            columns.extend(gram.whitened(count, |block| {
                if (edge[0]..edge[1]).contains(&gram.rows.time_s(block)) {
                    piece.columns(gram.rows, block)
                } else {
                    Columns::zero(count)
                }
            }));
        }
        let rows = gram.residual.len();
        let columns = DMatrix::from_fn(rows, columns.len(), |row, column| columns[column][row]);
        let products = inner(&columns, &columns);
        Pieces { candidate, columns, products }
    }
}

/// Cumulative sums over pieces: products of columns, and products of columns with the residual.
struct Sums {
    count: usize,
    products: Vec<Vec<f64>>,
    with_residual: Vec<Vec<f64>>,
}

impl Sums {
    fn of(pieces: &Pieces, along: &[Vec<f64>], with_residual: &[f64], count: usize) -> Sums {
        let length = pieces.columns.ncols() / count;
        let reduced = |i: usize, j: usize| pieces.products[(i, j)] - dot(&along[i], &along[j]);
        let mut products = vec![vec![0.0; (length + 1) * count * count]; length + 1];
        let mut residual_sums = vec![vec![0.0; count]; length + 1];
        for a in 0..length {
            for k in 0..count {
                residual_sums[a + 1][k] = residual_sums[a][k] + with_residual[a * count + k];
            }
            for b in 0..length {
                for k in 0..count * count {
                    let own = reduced(a * count + k / count, b * count + k % count);
                    let at = |i: usize, j: usize| products[i][j * count * count + k];
                    let sum = at(a, b + 1) + at(a + 1, b) - at(a, b) + own;
                    products[a + 1][(b + 1) * count * count + k] = sum;
                }
            }
        }
        Sums { count, products, with_residual: residual_sums }
    }

    fn product(&self, from: usize, to: usize, i: usize, j: usize) -> f64 {
        let at = |a: usize, b: usize| self.products[a][(b * self.count + i) * self.count + j];
        at(to, to) - at(from, to) - at(to, from) + at(from, from)
    }

    fn with_residual(&self, from: usize, to: usize, i: usize) -> f64 {
        self.with_residual[to][i] - self.with_residual[from][i]
    }
}

/// Length of a piece of the even grid, s.
fn piece_s(rows: &Rows<'_>) -> f64 {
    let [from_s, to_s] = ends_s(rows);
    (to_s - from_s) / EDGE_PIECES as f64
}

/// Start and end of the present work blocks, s.
fn ends_s(rows: &Rows<'_>) -> [f64; 2] {
    let half_s = 0.5 * rows.session.block_s;
    let from_s = if rows.work_from < rows.len() { rows.time_s(rows.work_from) - half_s } else { 0.0 };
    let to_s = if rows.len() > 0 { rows.time_s(rows.len() - 1) + half_s } else { 1.0 };
    [from_s, to_s]
}

/// Candidate onsets and ends, s, ascending: an even grid, and the steps of the residual, since a large effect fits only
/// between its own edges.
fn edges_s(rows: &Rows<'_>) -> Vec<f64> {
    let [from_s, to_s] = ends_s(rows);
    let steps_s = steps_s(rows);
    let is_near_step =
        |at_s: f64| steps_s.iter().any(|step_s| (step_s - at_s).abs() < STEP_REPLACES * piece_s(rows));
    let mut edges_s: Vec<f64> = (1..EDGE_PIECES)
        .map(|piece| from_s + piece_s(rows) * piece as f64)
        .filter(|&at_s| !is_near_step(at_s))
        .chain(steps_s.iter().copied())
        .chain([from_s, to_s])
        .collect();
    edges_s.sort_by(f64::total_cmp);
    edges_s
}

/// Largest steps of the residual, s; except at a change of stance.
fn steps_s(rows: &Rows<'_>) -> Vec<f64> {
    let (side, ignored) = STEP_BLOCKS;
    let first = rows.work_from + side + ignored;
    let last = rows.len().saturating_sub(side + ignored);
    let mut steps: Vec<(f64, usize)> = (first..last.max(first)).map(|at| (step_size(rows, at), at)).collect();
    steps.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<usize> = Vec::new();
    for (size, at) in steps {
        if size < 1.0 || kept.len() == STEPS_MAX {
            break;
        }
        if kept.iter().all(|&other| at.abs_diff(other) > side) {
            kept.push(at);
        }
    }
    kept.into_iter().map(|at| 0.5 * (rows.time_s(at - 1) + rows.time_s(at))).collect()
}

/// Size of the residual's step just before a block, in units of [`STEP_MIN`]: the largest of the channels.
fn step_size(rows: &Rows<'_>, at: usize) -> f64 {
    let (side, ignored) = STEP_BLOCKS;
    let before = at - side - ignored..at - ignored;
    let after = at + ignored..at + ignored + side;
    let same_stance = rows.blocks[before.start].stance == rows.blocks[after.end - 1].stance;
    let value = |block: usize| {
        let [x, y] = rows.cop_residual_m(block);
        [x, y, rows.force_residual_n(block, 2)]
    };
    (0..3)
        .filter(|&signal| same_stance || signal == 2)
        .map(|signal| {
            let [before, after] =
                [before.clone(), after.clone()].map(|side| median(side.map(|block| value(block)[signal])));
            (after - before).abs() / STEP_MIN[signal]
        })
        .fold(0.0, f64::max)
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constants::{CUTOFFS_HZ, LAGS_S};

    #[test]
    fn what_is_looked_for_in_parts_is_on_the_grids() {
        assert!(PART_LAGS_S.iter().all(|lag_s| LAGS_S.contains(lag_s)));
        assert!(PART_CUTOFFS_HZ.iter().all(|cutoff_hz| CUTOFFS_HZ.contains(cutoff_hz)));
    }
}
