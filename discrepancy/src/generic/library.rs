//! The library: terms by their columns at every block of the work.

use equipoise_core::effect::Columns;

use super::{forces, plate, regions, shifts};
use crate::rows::Rows;

/// A term of the library.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    /// Description.
    pub(crate) what: String,
    /// Whether no catalogue effect is a part of it.
    pub(crate) is_unlike: bool,
    /// Whether it is an error of the suit: evidence must then come from the centre of pressure, since accelerations
    /// alone are weak evidence.
    pub(crate) is_of_the_suit: bool,
    /// Prior size of each parameter, 1-σ.
    pub(crate) sigma: Vec<f64>,
    /// Its columns, one for each block of the work.
    pub(crate) columns: Vec<Columns>,
}

impl Entry {
    /// An entry defined block by block.
    pub(crate) fn of(rows: &Rows<'_>, what: String, sigma: &[f64], of: impl Fn(usize) -> Columns) -> Entry {
        let columns = (rows.work_from..rows.len()).map(of).collect();
        Entry { what, is_unlike: true, is_of_the_suit: false, sigma: sigma.to_vec(), columns }
    }

    /// The same entry, marked as partly in the catalogue.
    pub(crate) fn like_the_catalogue(self) -> Entry {
        Entry { is_unlike: false, ..self }
    }

    /// The same entry, marked as an error of the suit.
    pub(crate) fn of_the_suit(self) -> Entry {
        Entry { is_of_the_suit: true, ..self }
    }
}

/// All generic terms, in the work.
pub(crate) fn all(rows: &Rows<'_>) -> Vec<Entry> {
    let around = shifts::Around::of(rows);
    let mut list = forces::all(rows);
    list.extend(shifts::joints(&around));
    list.extend(shifts::slips(&around).into_iter().map(Entry::of_the_suit));
    list.extend(regions::all(&around).into_iter().map(Entry::of_the_suit));
    list.extend(plate::all(rows));
    list
}
