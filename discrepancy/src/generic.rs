//! Residuals that no catalogue effect explains, described in terms of the body: sparse search of a library of generic
//! terms by the same evidence.

mod library;
mod regions;
mod search;
mod shifts;

use crate::constants::{GENERIC_BEYOND_CHANCE, GENERIC_MAX};
use crate::finding::Generic;
use crate::gram::Gram;
pub(crate) use search::{FittedEntry, Library};

/// The library of generic terms, whitened.
pub(crate) fn library(gram: &Gram<'_>) -> Library {
    Library::of(gram, library::all(gram.rows))
}

/// Terms that explain the residual of the accepted effects, best first.
pub(crate) fn search(gram: &Gram<'_>, library: &Library, accepted: &[usize], threshold: f64) -> Vec<Generic> {
    let threshold = threshold.max(library.chance_level()) + GENERIC_BEYOND_CHANCE;
    library.greedy(gram, accepted, threshold, GENERIC_MAX)
}
