//! The station's incidents: any thread may begin or end one; changes go to the journal and the bus.
//!
//! The loop does not use this module: it counts in its cycle records, and housekeeping derives incidents from the
//! counts.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use bytemuck::Zeroable;
use equipoise_core::message::incident::KINDS_MAX;
use equipoise_core::message::{Incident, Incidents};
use tracing::{info, warn};

use crate::realtime::now_ns;

/// Interval between journal lines for one kind; repetitions are counted in the next line. As `RESTS_AFTER_NS` of
/// `supervision/growth.rs`: a fault that repeats every second gives a few lines a minute.
const JOURNAL_INTERVAL_NS: u64 = 10_000_000_000;
/// Maximum number of different sentences for one kind within that interval, enough for two devices that alternate. A
/// sentence that changes constantly quotes a faulty device.
const MESSAGES_MAX: u32 = 4;

/// Journal state of one kind.
#[derive(Debug, Default)]
struct JournalState {
    /// Time of the first of `lines`.
    since_ns: u64,
    /// Number of lines within [`JOURNAL_INTERVAL_NS`] of it.
    lines: u32,
    /// Text of the last line.
    what: String,
    /// Whether the last begin was logged.
    is_logged: bool,
    /// Sentences suppressed since the last line.
    repeated: u32,
}

impl JournalState {
    /// The end of the line to log at `now_ns`; `None` if the line is suppressed.
    fn due(&mut self, now_ns: u64, what: &str) -> Option<String> {
        if self.lines > 0 && now_ns.saturating_sub(self.since_ns) >= JOURNAL_INTERVAL_NS {
            self.lines = 0;
        }
        self.is_logged = self.lines == 0 || (self.lines < MESSAGES_MAX && self.what != what);
        if !self.is_logged {
            return None;
        }
        if self.lines == 0 {
            self.since_ns = now_ns;
        }
        self.lines += 1;
        what.clone_into(&mut self.what);
        Some(match std::mem::take(&mut self.repeated) {
            0 => String::new(),
            1 => " (and once more since the last line)".to_owned(),
            count => format!(" (and {count} times more since the last line)"),
        })
    }

    /// As [`Self::due`] for a new sentence; a suppressed one is counted.
    fn due_or_counted(&mut self, now_ns: u64, what: &str) -> Option<String> {
        let due = self.due(now_ns, what);
        self.repeated += u32::from(due.is_none());
        due
    }
}

/// Active incidents, and counts and times of all.
#[derive(Debug, Default)]
pub struct IncidentBoard {
    active: AtomicU64,
    begun: [AtomicU64; KINDS_MAX],
    last_begun_ns: [AtomicU64; KINDS_MAX],
    last_ended_ns: [AtomicU64; KINDS_MAX],
    /// Increments with every begin and end.
    changes: AtomicU64,
    /// Sentences of active incidents, by name.
    messages: Mutex<BTreeMap<&'static str, String>>,
    journal: Mutex<BTreeMap<&'static str, JournalState>>,
}

impl IncidentBoard {
    /// Begins an incident; `what` states location and remedy. An active incident does not begin again, but takes the
    /// new sentence.
    pub fn begin(&self, kind: Incident, what: &str) {
        let before = self.with_messages(|messages| messages.insert(kind.name(), what.to_owned()));
        if self.active.fetch_or(bit(kind), Ordering::Relaxed) & bit(kind) == 0 {
            self.raise(kind, what);
        } else if before.as_deref() != Some(what) {
            self.changes.fetch_add(1, Ordering::Relaxed);
            if let Some(repeated) = self.with_journal(kind, |journal| journal.due_or_counted(now_ns(), what))
            {
                warn!(incident = kind.name(), "still: {what}{repeated}");
            }
        } else {
            self.log_if_due(kind, what);
        }
    }

    /// Ends an incident if it is active.
    pub fn end(&self, kind: Incident) {
        if self.active.fetch_and(!bit(kind), Ordering::Relaxed) & bit(kind) != 0 {
            self.last_ended_ns[kind as usize].store(now_ns(), Ordering::Relaxed);
            self.changes.fetch_add(1, Ordering::Relaxed);
            self.with_messages(|messages| messages.remove(kind.name()));
            if self.with_journal(kind, |journal| std::mem::take(&mut journal.is_logged)) {
                info!(incident = kind.name(), "ended");
            }
        }
    }

    /// Records an incident without a duration.
    pub fn report_once(&self, kind: Incident, what: &str) {
        self.raise(kind, what);
        self.last_ended_ns[kind as usize].store(now_ns(), Ordering::Relaxed);
    }

    /// Begins or ends an incident according to `active`. While it is active, its sentence is updated from `what`; the
    /// journal keeps the sentence of the begin.
    pub fn set(&self, kind: Incident, active: bool, what: impl FnOnce() -> String) {
        if !active {
            self.end(kind);
        } else if self.is_active(kind) {
            let what = what();
            self.log_if_due(kind, &what);
            self.with_messages(|messages| messages.insert(kind.name(), what));
        } else {
            self.begin(kind, &what());
        }
    }

    /// Begins an incident with the sentence `what`, or updates that of an active one. `details`, made from the number of
    /// incidents of this kind so far, follow in parentheses, but not in the journal, so that they do not make another
    /// line.
    pub fn set_with_details(&self, kind: Incident, what: &str, details: impl FnOnce(u64) -> String) {
        if self.is_active(kind) {
            self.log_if_due(kind, what);
        } else {
            self.begin(kind, what);
        }
        let count = self.begun[kind as usize].load(Ordering::Relaxed);
        let message = format!("{what} ({})", details(count));
        self.with_messages(|messages| messages.insert(kind.name(), message));
    }

    /// Logs the line of an active incident that was suppressed at its begin because it followed another line too soon.
    fn log_if_due(&self, kind: Incident, what: &str) {
        let due =
            |journal: &mut JournalState| if journal.is_logged { None } else { journal.due(now_ns(), what) };
        if let Some(repeated) = self.with_journal(kind, due) {
            warn!(incident = kind.name(), "still: {what}{repeated}");
        }
    }

    /// Whether an incident is active.
    pub fn is_active(&self, kind: Incident) -> bool {
        self.active.load(Ordering::Relaxed) & bit(kind) != 0
    }

    /// Number of begins and ends: an increase means that there is something to publish.
    pub fn changes(&self) -> u64 {
        self.changes.load(Ordering::Relaxed)
    }

    /// Sentences of active incidents, by name.
    pub fn messages(&self) -> BTreeMap<String, String> {
        self.with_messages(|messages| {
            messages.iter().map(|(name, what)| ((*name).to_owned(), what.clone())).collect()
        })
    }

    /// The board as a message for the bus.
    pub fn message(&self) -> Incidents {
        let read = |counters: &[AtomicU64; KINDS_MAX]| {
            core::array::from_fn(|index: usize| counters[index].load(Ordering::Relaxed))
        };
        Incidents {
            time_ns: now_ns(),
            active: self.active.load(Ordering::Relaxed),
            begun: read(&self.begun),
            last_begun_ns: read(&self.last_begun_ns),
            last_ended_ns: read(&self.last_ended_ns),
            ..Incidents::zeroed()
        }
    }

    fn with_messages<T>(&self, access: impl FnOnce(&mut BTreeMap<&'static str, String>) -> T) -> T {
        // Ignore poisoning: no operation leaves the map half changed.
        access(&mut self.messages.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn with_journal<T>(&self, kind: Incident, access: impl FnOnce(&mut JournalState) -> T) -> T {
        let mut journal = self.journal.lock().unwrap_or_else(PoisonError::into_inner);
        access(journal.entry(kind.name()).or_default())
    }

    fn raise(&self, kind: Incident, what: &str) {
        self.begun[kind as usize].fetch_add(1, Ordering::Relaxed);
        self.last_begun_ns[kind as usize].store(now_ns(), Ordering::Relaxed);
        if let Some(repeated) = self.with_journal(kind, |journal| journal.due_or_counted(now_ns(), what)) {
            warn!(incident = kind.name(), "{what}{repeated}");
        }
        // After the journal's line, because this change publishes the incident.
        self.changes.fetch_add(1, Ordering::Relaxed);
    }
}

fn bit(kind: Incident) -> u64 {
    1 << kind as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repetitions_are_counted_and_not_logged() {
        let mut journal = JournalState::default();
        let mut due = |at_ns: u64, what: &str| journal.due_or_counted(at_ns, what);
        assert_eq!(due(5, "a").as_deref(), Some(""));
        assert_eq!((due(6, "a"), due(JOURNAL_INTERVAL_NS, "a")), (None, None));
        assert_eq!(
            due(JOURNAL_INTERVAL_NS + 5, "a").as_deref(),
            Some(" (and 2 times more since the last line)")
        );
        // A different device has a different message; a message that changes constantly is suppressed.
        let lines = (0..100).filter(|number| due(2 * JOURNAL_INTERVAL_NS + 5, &number.to_string()).is_some());
        assert_eq!(lines.count(), MESSAGES_MAX as usize);
        assert_eq!(
            due(3 * JOURNAL_INTERVAL_NS + 5, "a").as_deref(),
            Some(" (and 96 times more since the last line)")
        );
    }

    #[test]
    fn the_message_of_an_active_incident_has_current_counts() {
        let board = IncidentBoard::default();
        for count in 1..=3 {
            board.set(Incident::DeadlineMissed, true, || format!("{count} so far"));
        }
        assert_eq!(board.messages()["deadline_missed"], "3 so far");
        assert_eq!(board.message().begun[Incident::DeadlineMissed as usize], 1);
        board.set(Incident::DeadlineMissed, false, String::new);
        assert!(board.messages().is_empty());
    }

    #[test]
    fn an_incident_is_logged_once_until_it_ends() {
        let board = IncidentBoard::default();
        for _ in 0..3 {
            board.begin(Incident::SuitSilent, "for the test");
        }
        let changes = board.changes();
        board.begin(Incident::SuitSilent, "for another reason");
        assert_eq!(board.messages()["suit_silent"], "for another reason");
        assert_eq!(board.changes(), changes + 1, "those who tell it must look again");
        board.report_once(Incident::InputOverflow, "for the test");
        let message = board.message();
        assert_eq!(message.active().collect::<Vec<_>>(), [Incident::SuitSilent]);
        assert_eq!(message.begun[Incident::SuitSilent as usize], 1);
        assert_eq!(message.begun[Incident::InputOverflow as usize], 1);
        let changes = board.changes();
        board.end(Incident::SuitSilent);
        board.end(Incident::SuitSilent);
        assert_eq!(board.changes(), changes + 1);
        board.set(Incident::SuitSilent, true, || "again".to_owned());
        assert_eq!(board.message().begun[Incident::SuitSilent as usize], 2);
        assert!(board.is_active(Incident::SuitSilent));
    }
}
