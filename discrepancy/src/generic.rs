//! Residuals that no catalogue effect explains, described in terms of the body: sparse search of a library of generic
//! terms by the same evidence.

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

/// Largest number of reported generic terms.
const REPORTED_MAX: usize = 3;

/// Required gain of a generic term beyond the level reached by chance, log odds: shapes computed from the suit's motion
/// never match the body's exactly. Clean sessions stay below.
const SEARCHED: f64 = 2.0;

/// Results of the library search.
#[derive(Debug, Clone, Default)]
pub(crate) struct Generics {
    /// Terms that explain the residual of the catalogue, best first.
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
        after: search.greedy(gram, &terms, least, REPORTED_MAX, |_| true),
        unlike: sum(search.greedy(gram, &[], least, 1, |entry| entry.is_unlike)),
    }
}
