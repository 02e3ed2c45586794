//! What nothing in the catalogue explains, in words of the body: a library of generic terms, searched sparsely by the same
//! evidence.

mod forces;
mod library;
mod plate;
mod regions;
mod search;
mod shifts;
mod words;

use crate::finding::Generic;
use crate::gram::Gram;
use crate::select::Selection;
use search::Search;

pub(crate) use words::words;

/// Most generic terms that are told.
const TOLD_MAX: usize = 3;

/// What a generic term must gain beyond what chance reaches, in log odds: shapes that are made of the suit's own motion
/// are never quite as the body's. Clean sessions stay below.
const SEARCHED: f64 = 2.0;

/// What the library says.
#[derive(Debug, Clone, Default)]
pub(crate) struct Generics {
    /// Terms that explain what the catalogue leaves, best first.
    pub(crate) after: Vec<Generic>,
    /// Log Bayes factor of as many generic terms as effects were named (at least one) without the catalogue.
    pub(crate) alone: f64,
    /// Log Bayes factor of the best single term that is unlike everything in the catalogue, without the catalogue.
    pub(crate) unlike: f64,
}

/// Searches the library.
pub(crate) fn look(gram: &Gram<'_>, selection: &Selection, threshold: f64) -> Generics {
    let search = Search::of(gram, library::all(gram.rows));
    let least = threshold.max(search.by_chance()) + SEARCHED;
    let terms = selection.terms();
    let sum = |found: Vec<Generic>| found.iter().map(|generic| generic.log_odds).sum();
    Generics {
        alone: sum(search.greedy(gram, &[], least, terms.len().max(1), |_| true)),
        after: search.greedy(gram, &terms, least, TOLD_MAX, |_| true),
        unlike: sum(search.greedy(gram, &[], least, 1, |entry| entry.is_unlike)),
    }
}
