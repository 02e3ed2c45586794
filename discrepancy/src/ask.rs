//! What to do next to tell apart what these data cannot.

use crate::gram::Gram;
use crate::select::Selection;

/// The pose or motion that separates the two leading explanations most; `None` if nothing needs it.
pub(crate) fn ask(_gram: &Gram<'_>, _selection: &Selection) -> Option<String> {
    None
}
