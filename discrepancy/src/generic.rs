//! Residuals that no catalogue effect explains, described in terms of the body: sparse search of a library of generic
//! terms by the same evidence.

mod library;
mod regions;
mod search;
mod shifts;

use crate::constants::{GENERIC_BEYOND_CHANCE, GENERIC_MAX};
use crate::finding::Generic;
use crate::gram::Gram;
use crate::select::Selection;
use search::Search;

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
pub(crate) fn search(gram: &Gram<'_>, selection: &Selection, threshold: f64) -> Generics {
    let search = Search::of(gram, library::all(gram.rows));
    let threshold = threshold.max(search.chance_level()) + GENERIC_BEYOND_CHANCE;
    let terms = selection.terms();
    let sum = |terms: Vec<Generic>| terms.iter().map(|generic| generic.log_odds).sum();
    Generics {
        alone: sum(search.greedy(gram, &[], threshold, terms.len().max(1), |_| true)),
        after: search.greedy(gram, &terms, threshold, GENERIC_MAX, |_| true),
        unlike: sum(search.greedy(gram, &[], threshold, 1, |entry| entry.is_unlike_catalogue)),
    }
}
