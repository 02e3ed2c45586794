//! Counts the messages written to a recording and those lost.

use std::fmt;

/// Messages of a kind with consecutive numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Numbered {
    /// Messages written.
    pub written: u64,
    /// Missing numbers.
    pub lost: u64,
    /// Number of restarts of the numbering, one for each restart of the publisher.
    pub restarts: u64,
    last: Option<u64>,
}

impl Numbered {
    pub(super) fn ingest(&mut self, number: u64) {
        self.written += 1;
        match self.last {
            Some(last) if number > last => self.lost += number - last - 1,
            Some(_) => self.restarts += 1,
            None => {}
        }
        self.last = Some(number);
    }
}

/// Content of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RecordSummary {
    /// Cycle records.
    pub cycles: Numbered,
    /// States.
    pub states: Numbered,
    /// Early states, which have no consecutive numbers.
    pub early: u64,
    /// Suit samples.
    pub suit: Numbered,
    /// Ground samples.
    pub ground: Numbered,
    /// Copies of the loop's memory.
    pub checkpoints: u64,
    /// Health messages of the adapters.
    pub health: u64,
}

impl RecordSummary {
    fn numbered(&self) -> [(&'static str, Numbered); 4] {
        [
            ("cycle records", self.cycles),
            ("states", self.states),
            ("suit samples", self.suit),
            ("ground samples", self.ground),
        ]
    }

    /// Messages written.
    pub fn written(&self) -> u64 {
        let numbered: u64 = self.numbered().iter().map(|(_, kind)| kind.written).sum();
        numbered + self.early + self.checkpoints + self.health
    }

    /// Messages published but missing in the file.
    pub fn lost(&self) -> u64 {
        self.numbered().iter().map(|(_, kind)| kind.lost).sum()
    }
}

/// One line on written and lost messages.
impl fmt::Display for RecordSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, kind) in self.numbered() {
            write!(f, "{} {name}, ", kind.written)?;
        }
        write!(
            f,
            "{} early states, {} checkpoints, {} health messages; ",
            self.early, self.checkpoints, self.health
        )?;
        if self.lost() == 0 {
            return f.write_str("nothing lost");
        }
        let lost = self.numbered().into_iter().filter(|(_, kind)| kind.lost > 0);
        let lost: Vec<String> = lost.map(|(name, kind)| format!("{} {name}", kind.lost)).collect();
        write!(f, "lost: {} (the recorder was too slow, or a ring of the daemon was full)", lost.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_losses_and_a_number_that_falls_is_a_restart() {
        let mut summary = RecordSummary::default();
        for number in [7, 8, 11, 1, 2] {
            summary.suit.ingest(number);
        }
        assert_eq!((summary.suit.written, summary.suit.lost, summary.suit.restarts), (5, 2, 1));
        assert_eq!(summary.lost(), 2);
        assert!(summary.to_string().contains("lost: 2 suit samples"), "{summary}");
        assert!(RecordSummary::default().to_string().ends_with("nothing lost"));
    }
}
