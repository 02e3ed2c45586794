//! Content of a recording that determines how it is replayed.

use equipoise_adapters::recording::{Entry, RecordingHeader};
use equipoise_core::cycle::memory::MEMORY_VERSION;
use equipoise_core::cycle::{Checkpoint, Memory, Settings};
use equipoise_core::message::CommandKind;
use equipoise_core::time::NS_PER_S;

/// The recorder attaches the profile of another subject within this time of its change, ns: at intervals of a second.
pub const SUBJECT_ATTACHED_WITHIN_NS: u64 = 3 * NS_PER_S;

/// Cycles, checkpoints and commands of a recording; empty for a capture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Survey {
    /// Number of cycle records.
    pub cycles: u64,
    /// Number of suit and ground samples.
    pub samples: u64,
    /// Number of checkpoints from which this release can resume.
    pub checkpoints: u64,
    /// Why the last unusable checkpoint was refused.
    pub checkpoint_refused: Option<String>,
    /// Due times of the cycles with a tare of the empty plate, ns.
    pub tares_ns: Vec<u64>,
    /// The first checkpoint from which this release can resume.
    first: Option<Box<Checkpoint>>,
    /// Due times of the cycles before and at each load of a subject and each restart of the daemon, ns.
    handovers_ns: Vec<[u64; 2]>,
    /// Number and due time, ns, of the last cycle.
    last: [u64; 2],
}

/// A change of the subject in a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SubjectChange {
    /// Due time of the first cycle with the other subject, CLOCK_MONOTONIC ns.
    pub at_ns: u64,
    /// The pseudonyms before and after.
    pub subjects: [String; 2],
}

impl Survey {
    /// Ingests the next entry of the recording.
    pub fn ingest(&mut self, entry: &Entry) {
        match entry {
            Entry::Cycle(record) => {
                self.cycles += 1;
                let [last_cycle, last_ns] = std::mem::replace(&mut self.last, [record.cycle, record.due_ns]);
                if record.command == CommandKind::Tare as u32 {
                    self.tares_ns.push(record.due_ns);
                }
                if record.command == CommandKind::SubjectLoad as u32 || record.cycle <= last_cycle {
                    self.handovers_ns.push([last_ns, record.due_ns]);
                }
            }
            Entry::Checkpoint(checkpoint) => match refusal(checkpoint) {
                None => {
                    self.checkpoints += 1;
                    self.first.get_or_insert_with(|| checkpoint.clone());
                }
                refused => self.checkpoint_refused = refused,
            },
            Entry::Suit(_) | Entry::Ground(_) => self.samples += 1,
            _ => {}
        }
    }

    /// The live loop's memory after the first usable checkpoint.
    pub fn first_memory(&self) -> Option<&Memory> {
        self.first.as_ref().and_then(|checkpoint| checkpoint.memory())
    }

    /// The memory of a loop that begins at the start of the recording: empty except for the recording's tare, since
    /// recorded samples are those before the tare.
    pub fn initial_memory(&self, settings: &Settings) -> Box<Memory> {
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(settings);
        if let Some(first) = self.first_memory() {
            memory.resume_tare(first.tare());
        }
        memory
    }

    /// The changes of the subject, in order.
    pub fn subject_changes(&self, header: &RecordingHeader) -> Vec<SubjectChange> {
        let changes = header.subject_changes().into_iter();
        changes
            .map(|(attached_ns, subjects)| SubjectChange { at_ns: self.changed_ns(attached_ns), subjects })
            .collect()
    }

    /// Due time of the cycle that changed to the subject whose profile was attached at this time, ns.
    fn changed_ns(&self, attached_ns: u64) -> u64 {
        let is_near = |time_ns: u64| time_ns.abs_diff(attached_ns) <= SUBJECT_ATTACHED_WITHIN_NS;
        let before = self.handovers_ns.iter().rfind(|[_, at_ns]| *at_ns <= attached_ns && is_near(*at_ns));
        // The status has another subject shortly before the loop, or long before the first cycle of a restarted daemon.
        let after = |[last_ns, at_ns]: &&[u64; 2]| {
            *at_ns > attached_ns && (*last_ns <= attached_ns || is_near(*last_ns))
        };
        let handover = before.or_else(|| self.handovers_ns.iter().find(after));
        handover.map_or(attached_ns, |[_, at_ns]| *at_ns)
    }

    /// Why the tare and the subject from before a recording of a live loop are unavailable; `None` if they are available.
    pub fn memory_unavailable(&self) -> Option<String> {
        match &self.checkpoint_refused {
            _ if self.checkpoints > 0 => None,
            Some(refusal) => Some(format!("the recording's checkpoints are refused ({refusal})")),
            None => (self.cycles > 0).then(|| "the recording has no checkpoint".to_owned()),
        }
    }
}

/// Why the replay cannot resume from a checkpoint.
fn refusal(checkpoint: &Checkpoint) -> Option<String> {
    if checkpoint.memory_version != MEMORY_VERSION {
        let found = checkpoint.memory_version;
        return Some(format!("another version of Equipoise made it (memory {found}, here {MEMORY_VERSION})"));
    }
    checkpoint.memory().is_none().then(|| "a number in it is out of range".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::CycleRecord;

    #[test]
    fn a_subject_changes_at_a_load_or_a_restart_near_its_profile() {
        let mut survey = Survey::default();
        let load = CommandKind::SubjectLoad as u32;
        // The second daemon starts 60 s after the end of the first.
        for (cycle, due_s, command) in
            [(1, 1, 0), (2, 10, load), (3, 11, 0), (4, 12, load), (5, 20, 0), (1, 80, 0), (2, 95, 0)]
        {
            let record = CycleRecord { cycle, due_ns: due_s * NS_PER_S, command, ..CycleRecord::zeroed() };
            survey.ingest(&record.into());
        }
        let changed_s = |attached_s: f64| survey.changed_ns((attached_s * 1e9) as u64) / NS_PER_S;
        assert_eq!([10.5, 12.9].map(changed_s), [10, 12], "the recorder attaches later");
        assert_eq!([9.9, 20.0, 81.0].map(changed_s), [10, 80, 80], "the status is earlier");
        assert_eq!(changed_s(90.0), 90, "the record of the load is missing");
    }
}
