//! Compares a replay with the recorded results of the live loop, and finds the first difference.

use std::fmt;

use equipoise_core::cycle::Memory;
use equipoise_core::message::{EarlyState, State};

/// Result of the comparison, and gaps in the recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Fidelity {
    /// Cycles replayed.
    pub cycles: u64,
    /// Cycle records before the first checkpoint or the first samples, which are not replayed.
    pub before_checkpoint: u64,
    /// Recorded states compared.
    pub states_compared: u64,
    /// Number of them that differ in any byte.
    pub states_differing: u64,
    /// Recorded early states compared.
    pub early_compared: u64,
    /// Number of them that differ in any byte.
    pub early_differing: u64,
    /// Later checkpoints compared.
    pub memories_compared: u64,
    /// Number of them that differ in any byte.
    pub memories_differing: u64,
    /// The first cycle that differs.
    pub first_differing: Option<u64>,
    /// Missing cycle records between others.
    pub cycles_missing: u64,
    /// Cycles whose input samples are missing in the recording.
    pub cycles_lacking_samples: u64,
    /// Commands unknown to this release.
    pub unknown_commands: u64,
    /// Records that are stored after later ones.
    pub out_of_order: u64,
    /// Number of daemon restarts.
    pub restarts: u64,
    /// Number of times the replay resumed from a later checkpoint, after a gap or a loaded subject.
    pub resumed: u64,
    /// Cycles for which the recording lacks a part of the loop's input or memory.
    pub uncertain: u64,
    /// The first of these cycles.
    pub uncertain_from: Option<u64>,
    /// Number of changes of the settings.
    pub reloads: u64,
    /// The cycle at which settings became active that the recording lacks; the replay ends there.
    pub unknown_settings_at: Option<u64>,
    /// The first cycle of a restarted daemon, whose settings the recording lacks; the replay ends there.
    pub unknown_daemon_at: Option<u64>,
    /// The first cycle of a later subject, of whom a replay from an empty memory has no data.
    pub other_subject_at: Option<u64>,
    /// Damage that ended reading before the end of the file.
    pub damage: Option<String>,
}

impl Fidelity {
    pub(super) fn compare_state(&mut self, replayed: &State, recorded: &State) {
        self.states_compared += 1;
        // The time of publication is not a result of the cycle.
        let recorded = &State { published_ns: replayed.published_ns, ..*recorded };
        if bytemuck::bytes_of(replayed) != bytemuck::bytes_of(recorded) {
            self.states_differing += 1;
            self.first_differing.get_or_insert(recorded.cycle);
        }
    }

    pub(super) fn compare_early(&mut self, replayed: &EarlyState, recorded: &EarlyState) {
        self.early_compared += 1;
        let recorded = &EarlyState { published_ns: replayed.published_ns, ..*recorded };
        if bytemuck::bytes_of(replayed) != bytemuck::bytes_of(recorded) {
            self.early_differing += 1;
            self.first_differing.get_or_insert(recorded.cycle);
        }
    }

    pub(super) fn compare_memory(&mut self, replayed: &Memory, recorded: &Memory) {
        self.memories_compared += 1;
        if bytemuck::bytes_of(replayed) != bytemuck::bytes_of(recorded) {
            self.memories_differing += 1;
            self.first_differing.get_or_insert(recorded.state.cycle);
        }
    }

    pub(super) fn uncertain_at(&mut self, cycle: u64) {
        self.uncertain += 1;
        self.uncertain_from.get_or_insert(cycle);
    }

    /// Whether the recording is complete and every state was reproduced.
    pub fn is_exact(&self) -> bool {
        self.states_differing == 0
            && self.early_differing == 0
            && self.memories_differing == 0
            && self.is_complete()
    }

    /// Whether the recording contains all that the replay needs.
    pub fn is_complete(&self) -> bool {
        self.cycles_missing == 0
            && self.cycles_lacking_samples == 0
            && self.unknown_commands == 0
            && self.out_of_order == 0
            && self.uncertain == 0
            && self.unknown_settings_at.is_none()
            && self.unknown_daemon_at.is_none()
            && self.other_subject_at.is_none()
            && self.damage.is_none()
    }
}

/// One line for each finding.
impl fmt::Display for Fidelity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.states_compared + self.memories_compared > 0 {
            write!(
                f,
                "compared with the live loop: {} of {} states, {} of {} early states and {} of {} checkpoints differ",
                self.states_differing,
                self.states_compared,
                self.early_differing,
                self.early_compared,
                self.memories_differing,
                self.memories_compared
            )?;
            match self.first_differing {
                Some(cycle) => writeln!(f, "; the first at cycle {cycle}")?,
                None => writeln!(f)?,
            }
        }
        let findings = [
            (self.cycles_missing, "cycle records are missing between others"),
            (self.cycles_lacking_samples, "cycles took samples that the recording lacks"),
            (self.unknown_commands, "commands are of a later version and were left out"),
            (self.out_of_order, "cycle records stand behind later ones and were left out"),
            (self.restarts, "times the daemon was restarted"),
            (self.reloads, "times other settings came into force"),
            (self.resumed, "times the replay went on from a later checkpoint"),
        ];
        for (count, what) in findings.into_iter().filter(|(count, _)| *count > 0) {
            writeln!(f, "{count} {what}")?;
        }
        if let Some(cycle) = self.uncertain_from {
            let count = self.uncertain;
            writeln!(
                f,
                "not exact from cycle {cycle}: {count} cycles used what the recording lacks, and are not compared"
            )?;
        }
        if let Some(cycle) = self.unknown_settings_at {
            writeln!(
                f,
                "stopped at cycle {cycle}: the configuration was read again there, and the recording lacks the new one"
            )?;
        }
        if let Some(cycle) = self.unknown_daemon_at {
            writeln!(
                f,
                "stopped at cycle {cycle} of a restarted daemon: the recording lacks its configuration; replay with --config \
                 to continue"
            )?;
        }
        if let Some(cycle) = self.other_subject_at {
            writeln!(
                f,
                "another worker from cycle {cycle} on: identified again, since a replay with other settings has no profile and \
                 no shift of a later worker"
            )?;
        }
        if let Some(damage) = &self.damage {
            writeln!(f, "{damage}")?;
        }
        Ok(())
    }
}
