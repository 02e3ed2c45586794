//! Omitted parts of a capture, by reason.

use std::collections::BTreeMap;
use std::fmt;

/// Occurrences of one reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tally {
    /// Count of rows or packets.
    pub count: u64,
    /// The first of them: a line number (CSV, from 1; the header is line 1) or a packet number (pcap, from 1).
    pub first: u64,
}

/// Rows or packets omitted, by reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rejected {
    place: &'static str,
    tallies: BTreeMap<&'static str, Tally>,
}

impl Rejected {
    /// An empty list; `place` is the numbered item: "line" or "packet".
    pub(super) fn by(place: &'static str) -> Rejected {
        Rejected { place, tallies: BTreeMap::new() }
    }

    pub(super) fn count(&mut self, reason: &'static str, place: u64) {
        self.tallies.entry(reason).or_insert(Tally { count: 0, first: place }).count += 1;
    }

    /// Total count of omitted items.
    pub fn total(&self) -> u64 {
        self.tallies.values().map(|tally| tally.count).sum()
    }

    /// Whether nothing was omitted.
    pub fn is_empty(&self) -> bool {
        self.tallies.is_empty()
    }

    /// Every reason that occurred, in alphabetical order.
    pub fn reasons(&self) -> impl Iterator<Item = (&'static str, Tally)> {
        self.tallies.iter().map(|(reason, tally)| (*reason, *tally))
    }

    /// Count of one reason.
    pub fn of(&self, reason: &str) -> u64 {
        self.tallies.get(reason).map_or(0, |tally| tally.count)
    }
}

/// One line: `3 not_finite (first at line 17), 1 time_not_increasing (first at line 40)`.
impl fmt::Display for Rejected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return f.write_str("none");
        }
        for (index, (reason, tally)) in self.reasons().enumerate() {
            let comma = if index == 0 { "" } else { ", " };
            write!(f, "{comma}{} {reason} (first at {} {})", tally.count, self.place, tally.first)?;
        }
        Ok(())
    }
}
