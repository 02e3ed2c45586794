//! Load, low back and accumulated exposure of the shift.

use equipoise_core::message::State;
use ratatui::text::Line;

use super::{cut, heading};
use crate::terminal;

/// One value per line; `-` if it is withheld.
pub(super) fn lines(state: &State, width: u16) -> Vec<Line<'static>> {
    let or_withheld = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
    let rows = [
        ("load", or_withheld(terminal::load(state))),
        ("low back", or_withheld(terminal::back(state))),
        ("worst", or_withheld(terminal::worst(state))),
        ("shift", terminal::shift(state)),
    ];
    let lines = rows.map(|(name, value)| Line::raw(cut(&format!(" {name:<8} {value}"), width)));
    if width >= super::TWO_COLUMNS_FROM / 2 + 4 {
        [heading("Load and dose")].into_iter().chain(lines).collect()
    } else {
        lines.to_vec()
    }
}

/// Progress of the identification.
pub(super) fn progress(state: &State) -> String {
    terminal::progress(state)
}
