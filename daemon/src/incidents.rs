//! The station's incidents: every thread may say that one begins or ends; the journal and the bus hear of it.
//!
//! Nothing here is for the loop: it counts in its cycle records, and housekeeping makes incidents of the counts.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use bytemuck::Zeroable;
use equipoise_core::message::incident::KINDS_MAX;
use equipoise_core::message::{Incident, Incidents};
use tracing::{info, warn};

use crate::realtime::now_ns;

/// What goes on, and what went on.
#[derive(Debug, Default)]
pub struct IncidentBoard {
    active: AtomicU64,
    begun: [AtomicU64; KINDS_MAX],
    last_begun_ns: [AtomicU64; KINDS_MAX],
    last_ended_ns: [AtomicU64; KINDS_MAX],
    /// Grows with every beginning and end.
    changes: AtomicU64,
    /// What was said of those that go on, by name.
    said: Mutex<BTreeMap<&'static str, String>>,
}

impl IncidentBoard {
    /// An incident begins; `what` tells where and what to do. While it goes on it is not begun again, but what is said of
    /// it is what was said last.
    pub fn begin(&self, kind: Incident, what: &str) {
        let before = self.with_said(|said| said.insert(kind.name(), what.to_owned()));
        if self.active.fetch_or(bit(kind), Ordering::Relaxed) & bit(kind) == 0 {
            self.enter(kind, what);
        } else if before.as_deref() != Some(what) {
            self.changes.fetch_add(1, Ordering::Relaxed);
            warn!(incident = kind.name(), "still: {what}");
        }
    }

    /// An incident ends, if it goes on.
    pub fn end(&self, kind: Incident) {
        if self.active.fetch_and(!bit(kind), Ordering::Relaxed) & bit(kind) != 0 {
            self.last_ended_ns[kind as usize].store(now_ns(), Ordering::Relaxed);
            self.changes.fetch_add(1, Ordering::Relaxed);
            self.with_said(|said| said.remove(kind.name()));
            info!(incident = kind.name(), "ended");
        }
    }

    /// Something that happens at once and has no length.
    pub fn happened(&self, kind: Incident, what: &str) {
        self.enter(kind, what);
        self.last_ended_ns[kind as usize].store(now_ns(), Ordering::Relaxed);
    }

    /// Begins or ends, as `goes_on` says.
    pub fn set(&self, kind: Incident, goes_on: bool, what: impl FnOnce() -> String) {
        if !goes_on {
            self.end(kind);
        } else if !self.is_active(kind) {
            self.begin(kind, &what());
        }
    }

    /// Whether it goes on.
    pub fn is_active(&self, kind: Incident) -> bool {
        self.active.load(Ordering::Relaxed) & bit(kind) != 0
    }

    /// How often something has begun or ended: whoever sees it grow has something to publish.
    pub fn changes(&self) -> u64 {
        self.changes.load(Ordering::Relaxed)
    }

    /// What was said of those that go on, by name.
    pub fn sentences(&self) -> BTreeMap<String, String> {
        self.with_said(|said| said.iter().map(|(name, what)| ((*name).to_owned(), what.clone())).collect())
    }

    /// The board as the bus has it.
    pub fn message(&self) -> Incidents {
        let read = |places: &[AtomicU64; KINDS_MAX]| {
            core::array::from_fn(|place: usize| places[place].load(Ordering::Relaxed))
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

    fn with_said<T>(&self, look: impl FnOnce(&mut BTreeMap<&'static str, String>) -> T) -> T {
        // A map is never half changed.
        look(&mut self.said.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn enter(&self, kind: Incident, what: &str) {
        self.begun[kind as usize].fetch_add(1, Ordering::Relaxed);
        self.last_begun_ns[kind as usize].store(now_ns(), Ordering::Relaxed);
        self.changes.fetch_add(1, Ordering::Relaxed);
        warn!(incident = kind.name(), "{what}");
    }
}

fn bit(kind: Incident) -> u64 {
    1 << kind as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_incident_is_told_once_until_it_ends() {
        let board = IncidentBoard::default();
        for _ in 0..3 {
            board.begin(Incident::SuitSilent, "for the test");
        }
        let changes = board.changes();
        board.begin(Incident::SuitSilent, "for another reason");
        assert_eq!(board.sentences()["suit_silent"], "for another reason");
        assert_eq!(board.changes(), changes + 1, "those who tell it must look again");
        board.happened(Incident::InputOverflow, "for the test");
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
