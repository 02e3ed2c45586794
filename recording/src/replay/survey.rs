//! Content of a recording that determines how it is replayed.

use equipoise_adapters::recording::Entry;
use equipoise_core::cycle::memory::MEMORY_VERSION;
use equipoise_core::cycle::{Checkpoint, Memory, Settings};
use equipoise_core::message::CommandKind;

/// Cycles, checkpoints and tares of a recording; empty for a capture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Survey {
    /// Number of cycle records.
    pub cycles: u64,
    /// Number of checkpoints from which this release can resume.
    pub checkpoints: u64,
    /// Why the last unusable checkpoint was refused.
    pub checkpoint_refused: Option<String>,
    /// Due times of the cycles with a tare of the empty plate, ns.
    pub tares_ns: Vec<u64>,
    /// The first checkpoint from which this release can resume.
    first: Option<Box<Checkpoint>>,
}

impl Survey {
    /// Ingests the next entry of the recording.
    pub fn ingest(&mut self, entry: &Entry) {
        match entry {
            Entry::Cycle(record) => {
                self.cycles += 1;
                if record.command == CommandKind::Tare as u32 {
                    self.tares_ns.push(record.due_ns);
                }
            }
            Entry::Checkpoint(checkpoint) => match refusal(checkpoint) {
                None => {
                    self.checkpoints += 1;
                    self.first.get_or_insert_with(|| checkpoint.clone());
                }
                refused => self.checkpoint_refused = refused,
            },
            _ => {}
        }
    }

    /// The live loop's memory after the first usable checkpoint.
    pub fn first_memory(&self) -> Option<&Memory> {
        self.first.as_ref().and_then(|checkpoint| checkpoint.memory())
    }

    /// The memory of a loop that starts at the begin of the recording: empty except for the recording's tare, since
    /// recorded samples are those before the tare.
    pub fn initial_memory(&self, settings: &Settings) -> Box<Memory> {
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(settings);
        if let Some(first) = self.first_memory() {
            memory.resume_tare(first.tare());
        }
        memory
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
