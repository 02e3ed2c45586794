//! Incidents in plain English: meaning and remedy of each kind. `docs/operation.md` has the same table.

use equipoise_core::message::{Incident, Incidents};
use equipoise_core::time::seconds;

use crate::words::table::english;

/// Meaning and remedy of a kind of incident.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Words {
    /// What has happened.
    pub meaning: &'static str,
    /// The remedy.
    pub to_do: &'static str,
}

/// The texts of a kind.
pub fn words(kind: Incident) -> Words {
    let part = |part: &str| english(&format!("incident.{}.{part}", kind.name())).unwrap_or(kind.name());
    Words { meaning: part("meaning"), to_do: part("do") }
}

/// Active incidents on one line, with their durations; `None` if there are none. `now_ns` is CLOCK_MONOTONIC.
pub fn line(incidents: &Incidents, now_ns: u64) -> Option<String> {
    let shown: Vec<String> = incidents
        .active()
        .map(|kind| {
            let since_ns = now_ns.saturating_sub(incidents.last_begun_ns[kind as usize]);
            format!("{} for {}", kind.name(), span(since_ns))
        })
        .collect();
    (!shown.is_empty()).then(|| shown.join(", "))
}

/// A duration for people: seconds, minutes or hours.
pub fn span(span_ns: u64) -> String {
    let whole_s = seconds(span_ns).round() as u64;
    match whole_s {
        0..120 => format!("{whole_s} s"),
        120..7200 => format!("{} min", whole_s / 60),
        _ => format!("{} h", whole_s / 3600),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn every_kind_has_words_of_its_own_that_stand_on_one_line_of_a_table() {
        for kind in Incident::ALL {
            let Words { meaning, to_do } = words(*kind);
            assert!(meaning.len() > 20 && to_do.len() > 20, "{}", kind.name());
            assert!(!meaning.contains('|') && !to_do.contains('|'), "{}", kind.name());
        }
    }

    #[test]
    fn the_document_has_the_same_words() {
        let document = include_str!("../../docs/operation.md");
        for kind in Incident::ALL {
            let Words { meaning, to_do } = words(*kind);
            let row = format!("| `{}` | {meaning} | {to_do} |", kind.name());
            assert!(document.lines().any(|line| line == row), "docs/operation.md lacks this row:\n{row}");
        }
    }

    #[test]
    fn the_line_names_what_goes_on_and_for_how_long() {
        let mut incidents = Incidents::zeroed();
        incidents.begun[Incident::NotSaved as usize] = 3;
        assert_eq!(line(&incidents, 5), None, "what is over is not on it");
        for (kind, since_s) in [(Incident::SuitSilent, 12), (Incident::DeadlineMissed, 9000)] {
            incidents.active |= 1 << kind as u32;
            incidents.last_begun_ns[kind as usize] = 10_000_000_000_000 - since_s * 1_000_000_000;
        }
        assert_eq!(
            line(&incidents, 10_000_000_000_000).as_deref(),
            Some("suit_silent for 12 s, deadline_missed for 2 h")
        );
    }
}
