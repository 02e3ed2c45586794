//! Data from cycle records other than latency: subject changes and the period.

use equipoise_core::message::CycleRecord;
use equipoise_core::message::command::CommandKind;

/// Data of all cycles of a recording, by their due time, which is also that of their states.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Records {
    loads_ns: Vec<u64>,
    deletions_ns: Vec<u64>,
    stops_ns: Vec<u64>,
    /// Start and length of each period setting, both ns.
    periods_ns: Vec<[u64; 2]>,
}

impl Records {
    /// Adds one record.
    pub fn ingest(&mut self, record: &CycleRecord) {
        let command = CommandKind::from_number(record.command);
        // Deleting the active subject also changes the subject: an unnamed one replaces it.
        if matches!(command, Some(CommandKind::SubjectLoad | CommandKind::SubjectDelete)) {
            self.loads_ns.push(record.due_ns);
        }
        if command == Some(CommandKind::SubjectDelete) {
            self.deletions_ns.push(record.due_ns);
        }
        if command == Some(CommandKind::IdentifyStop) {
            self.stops_ns.push(record.due_ns);
        }
        let is_new = self.periods_ns.last().is_none_or(|[_, period_ns]| *period_ns != record.period_ns);
        if record.period_ns > 0 && is_new {
            self.periods_ns.push([record.due_ns, record.period_ns]);
        }
    }

    /// Whether a subject was loaded after one state and until the next, both ns.
    pub fn has_load(&self, after_ns: u64, until_ns: u64) -> bool {
        any_within(&self.loads_ns, after_ns, until_ns)
    }

    /// Whether the subject in use was deleted after one state and until the next, both ns.
    pub fn has_deletion(&self, after_ns: u64, until_ns: u64) -> bool {
        any_within(&self.deletions_ns, after_ns, until_ns)
    }

    /// Whether a command ended the identification after one state and until the next, both ns.
    pub fn has_stop(&self, after_ns: u64, until_ns: u64) -> bool {
        any_within(&self.stops_ns, after_ns, until_ns)
    }

    /// The period at a time, ns; `None` without records.
    pub fn period_ns(&self, time_ns: u64) -> Option<u64> {
        let last = self.periods_ns.iter().rev().find(|[from_ns, _]| *from_ns <= time_ns);
        last.or(self.periods_ns.first()).map(|[_, period_ns]| *period_ns)
    }
}

fn any_within(times_ns: &[u64], after_ns: u64, until_ns: u64) -> bool {
    times_ns.iter().any(|time_ns| (after_ns + 1..=until_ns).contains(time_ns))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn loads_and_periods_are_found_by_time() {
        let mut records = Records::default();
        assert_eq!(records.period_ns(1), None);
        for (due_ns, period_ns, command) in [
            (10, 5, 0),
            (15, 5, CommandKind::SubjectLoad as u32),
            (20, 2, CommandKind::Tare as u32),
            (21, 2, CommandKind::IdentifyStop as u32),
            (22, 2, 0),
            (40, 2, CommandKind::SubjectDelete as u32),
        ] {
            records.ingest(&CycleRecord { due_ns, period_ns, command, ..CycleRecord::zeroed() });
        }
        assert_eq!([9, 15, 19, 20, 99].map(|time_ns| records.period_ns(time_ns)), [5, 5, 5, 2, 2].map(Some));
        assert!(records.has_load(10, 15) && records.has_load(12, 20), "also where its own state is missing");
        assert!(!records.has_load(15, 22) && !records.has_load(0, 14));
        assert!(records.has_load(22, 40) && records.has_deletion(22, 40) && !records.has_deletion(0, 22));
        assert!(records.has_stop(20, 21) && !records.has_stop(21, 30) && !records.has_stop(0, 20));
    }
}
