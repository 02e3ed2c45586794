//! Temporary effects: all pairs of onset and end over some two dozen pieces of the work, by cumulative sums of the
//! pieces' inner products; then the edges to a second.

use equipoise_core::body::Segment;
use equipoise_core::effect::{Columns, Effect, Place};

use crate::candidate::{Candidate, Scope, usual};
use crate::edges::{edges_s, ends_s, piece_s};
use crate::evidence::log_odds;
use crate::gram::Gram;
use crate::linear::dot;

/// Required gain of a part over the whole, in log odds, in addition to the penalty for the number of parts tried.
pub(crate) const GAIN_OVER_WHOLE: f64 = 3.0;
/// And this fraction of the explained evidence: with two free edges, a wrong explanation fits a large effect well.
const MODEL_ERROR: f64 = 0.12;
/// The same where the effect's name is certain.
const MODEL_ERROR_OF_EDGES: f64 = 0.02;
/// Lags and cutoffs tried in parts; their fitted factor covers the values in between.
const PART_LAGS_S: [f64; 4] = [-0.03, -0.01, 0.01, 0.03];
const PART_CUTOFFS_HZ: [f64; 3] = [1.0, 2.0, 4.5];
/// Shortest part of those, s: clocks and filters do not change for an instant.
const SHORTEST_TIMING_S: f64 = 20.0;
/// Shortest part, s.
const SHORTEST_S: f64 = 2.0;

/// An effect in the best-fitting part of the work.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// The effect with that time span.
    pub(crate) candidate: Candidate,
    /// Log Bayes factor, including the penalty for the number of parts.
    pub(crate) log_odds: f64,
    /// The same if the effect is certain and only its time span is in question.
    pub(crate) same_name: f64,
    /// Log Bayes factor of the whole work.
    pub(crate) of_whole: f64,
}

/// One candidate, cut into pieces and whitened.
struct Pieces {
    candidate: Candidate,
    columns: Vec<Vec<f64>>,
    products: Vec<Vec<f64>>,
}

/// All temporary candidates, prepared for repeated searches.
pub(crate) struct Windows {
    edges_s: Vec<f64>,
    pieces: Vec<Pieces>,
}

/// Candidates that may act in parts of the work: loads put on or taken up, contacts, knocked sensors and disturbances,
/// above the legs.
fn can_come_and_go(candidate: &Candidate) -> bool {
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

impl Windows {
    /// Prepares the candidates that may be temporary.
    pub(crate) fn of(gram: &Gram<'_>) -> Windows {
        let edges_s = edges_s(gram.rows);
        let pieces = gram
            .terms
            .iter()
            .filter_map(|term| term.candidate.as_ref())
            .filter(|candidate| candidate.scope == Scope::Work && can_come_and_go(candidate))
            .filter(|candidate| candidate.about.iter().all(|&about| about == 0.0))
            .map(|candidate| cut(gram, candidate, &edges_s))
            .collect();
        Windows { edges_s, pieces }
    }

    /// The best part of each, conditioned on the accepted terms; best first.
    pub(crate) fn best(&self, gram: &Gram<'_>, accepted: &[usize]) -> Vec<Part> {
        let (directions, residual) = gram.directions_given(accepted);
        let mut parts: Vec<Part> =
            self.pieces.iter().filter_map(|pieces| self.best_part(pieces, &directions, &residual)).collect();
        parts.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
        parts
    }

    fn best_part(&self, pieces: &Pieces, directions: &[Vec<f64>], residual: &[f64]) -> Option<Part> {
        let count = pieces.candidate.count();
        let along: Vec<Vec<f64>> = pieces
            .columns
            .iter()
            .map(|column| directions.iter().map(|direction| dot(column, direction)).collect())
            .collect();
        let on_residual: Vec<f64> = directions.iter().map(|direction| dot(direction, residual)).collect();
        let pull: Vec<f64> = pieces
            .columns
            .iter()
            .zip(&along)
            .map(|(column, along)| dot(column, residual) - dot(along, &on_residual))
            .collect();
        let sums = Sums::of(pieces, &along, &pull, count);
        let (mean, sigma) = (&pieces.candidate.mean, &pieces.candidate.sigma);
        let last = self.edges_s.len() - 1;
        let score = |from: usize, to: usize| {
            log_odds(&|i, j| sums.product(from, to, i, j), &|i| sums.pull(from, to, i), mean, sigma)
        };
        let of_whole = score(0, last);
        let is_timing = matches!(pieces.candidate.effect, Effect::SuitLag | Effect::PlateLowpass);
        let length_s = |from: usize, to: usize| self.edges_s[to] - self.edges_s[from];
        let shortest_s = if is_timing { SHORTEST_TIMING_S } else { SHORTEST_S }.min(length_s(0, last));
        let pairs = (0..last)
            .flat_map(|from| (from + 1..=last).map(move |to| (from, to)))
            .filter(|&(from, to)| length_s(from, to) >= shortest_s);
        let (from, to, best) =
            pairs.map(|(from, to)| (from, to, score(from, to))).max_by(|a, b| a.2.total_cmp(&b.2))?;
        let parts = (last * (last + 1) / 2) as f64;
        let paid = parts.ln() + 2.0_f64.ln() - usual(pieces.candidate.effect, pieces.candidate.place);
        let same_name = best - paid - MODEL_ERROR_OF_EDGES * best.max(0.0);
        let log_odds = best - paid - MODEL_ERROR * best.max(0.0);
        let scope = Scope::Span([self.edges_s[from], self.edges_s[to]]);
        let candidate = Candidate { scope, ..pieces.candidate.clone() };
        Some(Part { candidate, log_odds, same_name, of_whole })
    }
}

/// Moves both edges of a part as long as the evidence increases; the resolution is a block.
pub(crate) fn refine(gram: &Gram<'_>, candidate: &Candidate, accepted: &[usize]) -> Candidate {
    let Scope::Span(mut span_s) = candidate.scope else { return candidate.clone() };
    let (directions, residual) = gram.directions_given(accepted);
    let [least_s, most_s] = ends_s(gram.rows);
    let score = |span_s: [f64; 2]| {
        let candidate = Candidate { scope: Scope::Span(span_s), ..candidate.clone() };
        gram.score_alone(&candidate, &directions, &residual)
    };
    let mut best = score(span_s);
    let mut step_s = 0.5 * piece_s(gram.rows);
    while step_s > 0.3 {
        let moves = [[step_s, 0.0], [-step_s, 0.0], [0.0, step_s], [0.0, -step_s]];
        let better = moves.into_iter().find_map(|[from, to]| {
            let moved = [(span_s[0] + from).max(least_s), (span_s[1] + to).min(most_s)];
            let value = if moved[1] - moved[0] < SHORTEST_S { f64::NEG_INFINITY } else { score(moved) };
            (value > best + 1e-6).then_some((moved, value))
        });
        match better {
            Some((moved, value)) => (span_s, best) = (moved, value),
            None => step_s *= 0.5,
        }
    }
    Candidate { scope: Scope::Span(span_s), ..candidate.clone() }
}

/// Only the mass without its exact position, since a part is short.
fn simplified(candidate: &Candidate) -> Candidate {
    let mut simple = candidate.clone();
    let is_trunk = matches!(candidate.place, Place::Segment(Segment::T8 | Segment::Pelvis));
    if candidate.effect == Effect::HandLoad || (candidate.effect == Effect::WornMass && !is_trunk) {
        simple.mean.truncate(1);
        simple.sigma.truncate(1);
    }
    simple
}

fn cut(gram: &Gram<'_>, candidate: &Candidate, edges_s: &[f64]) -> Pieces {
    let candidate = simplified(candidate);
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
    let products = columns
        .iter()
        .enumerate()
        .map(|(i, column)| columns[..=i].iter().map(|other| dot(column, other)).collect())
        .collect();
    Pieces { candidate, columns, products }
}

/// Cumulative sums over pieces, of products of columns and of products with the residual.
struct Sums {
    count: usize,
    products: Vec<Vec<f64>>,
    pulls: Vec<Vec<f64>>,
}

impl Sums {
    fn of(pieces: &Pieces, along: &[Vec<f64>], pull: &[f64], count: usize) -> Sums {
        let length = pieces.columns.len() / count;
        let reduced = |i: usize, j: usize| {
            let (i, j) = (i.max(j), i.min(j));
            pieces.products[i][j] - dot(&along[i], &along[j])
        };
        let mut products = vec![vec![0.0; (length + 1) * count * count]; length + 1];
        let mut pulls = vec![vec![0.0; count]; length + 1];
        for a in 0..length {
            for k in 0..count {
                pulls[a + 1][k] = pulls[a][k] + pull[a * count + k];
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
        Sums { count, products, pulls }
    }

    fn product(&self, from: usize, to: usize, i: usize, j: usize) -> f64 {
        let at = |a: usize, b: usize| self.products[a][(b * self.count + i) * self.count + j];
        at(to, to) - at(from, to) - at(to, from) + at(from, from)
    }

    fn pull(&self, from: usize, to: usize, i: usize) -> f64 {
        self.pulls[to][i] - self.pulls[from][i]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::{CUTOFFS_HZ, LAGS_S};

    #[test]
    fn what_is_looked_for_in_parts_is_on_the_grids() {
        assert!(PART_LAGS_S.iter().all(|lag_s| LAGS_S.contains(lag_s)));
        assert!(PART_CUTOFFS_HZ.iter().all(|cutoff_hz| CUTOFFS_HZ.contains(cutoff_hz)));
    }
}
