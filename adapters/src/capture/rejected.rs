//! Counts the rows or packets that a reader of captures rejects: for each reason the number and the first occurrence,
//! for the summary of an import.

use std::collections::BTreeMap;
use std::fmt;

/// Rejections for one reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tally {
    /// Number of rows or packets.
    pub count: u64,
    /// The first of them: a line number (CSV, from 1; the header is line 1) or a packet number (pcap, from 1).
    pub first: u64,
}

/// Rejected rows or packets, by reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rejected {
    item: &'static str,
    tallies: BTreeMap<&'static str, Tally>,
}

impl Rejected {
    /// No rejections yet; `item` is the unit of the numbers passed to [`Self::count`]: "line" or "packet".
    pub(super) fn numbered_by(item: &'static str) -> Rejected {
        Rejected { item, tallies: BTreeMap::new() }
    }

    /// Counts one rejection, at line or packet `number` (from 1).
    pub(super) fn count(&mut self, reason: &'static str, number: u64) {
        self.tallies.entry(reason).or_insert(Tally { count: 0, first: number }).count += 1;
    }

    /// Number of rejected rows or packets.
    pub fn total(&self) -> u64 {
        self.tallies.values().map(|tally| tally.count).sum()
    }

    /// Whether nothing was rejected.
    pub fn is_empty(&self) -> bool {
        self.tallies.is_empty()
    }

    /// Every reason that occurred, in alphabetical order.
    pub fn reasons(&self) -> impl Iterator<Item = (&'static str, Tally)> {
        self.tallies.iter().map(|(reason, tally)| (*reason, *tally))
    }

    /// Number of rejections for one reason.
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
            let separator = if index == 0 { "" } else { ", " };
            write!(f, "{separator}{} {reason} (first at {} {})", tally.count, self.item, tally.first)?;
        }
        Ok(())
    }
}
