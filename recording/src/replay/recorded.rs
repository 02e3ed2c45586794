//! Replays the cycles of a recording: the same ticks, samples and commands, hence the same states.

use std::collections::{BTreeMap, VecDeque};

use equipoise_adapters::recording::Recording;
use equipoise_core::cycle::Checkpoint;
use equipoise_core::cycle::{Inputs, Memory, Settings, Tick};
use equipoise_core::message::{CommandKind, CycleRecord, GroundSample, State, SuitBody, SuitSample};

use super::feed::{Cycle, Feed};
use super::fidelity::Fidelity;
use super::machine::Machine;
use super::pending::IngestedSamples;

/// Start of a replay of cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Start {
    /// From the live loop's memory: reproduces its states byte for byte.
    Checkpoint,
    /// From an empty memory at the first cycle: for other settings, or without a checkpoint.
    Empty,
}

/// Calls `write` with the state and the record of every replayed cycle. `settings` are those of the recording's reloads
/// by number; `None` ignores reloads and restarts of the daemon and keeps the machine's own settings. From an empty
/// memory, `subjects` are the later subjects: due time of their first cycle, ns, and their settings.
///
/// # Errors
/// The error of `write`.
pub(super) fn run(
    recording: &Recording,
    machine: &mut Machine,
    start: Start,
    settings: Option<&BTreeMap<u64, Settings>>,
    subjects: VecDeque<(u64, Settings)>,
    mut write: impl FnMut(&State, &CycleRecord) -> anyhow::Result<()>,
) -> anyhow::Result<Fidelity> {
    let mut feed = Feed::new(recording);
    let mut run = Run {
        machine,
        start,
        settings,
        subjects,
        settings_number: None,
        exact: false,
        running: false,
        last: None,
        suit: Vec::new(),
        ground: Vec::new(),
        body: None,
        fidelity: Fidelity::default(),
    };
    while let Some(cycle) = feed.next_cycle() {
        if run.cycle(&mut feed, &cycle) {
            write(run.machine.state(), &cycle.record)?;
        }
        if run.fidelity.unknown_settings_at.is_some() || run.fidelity.unknown_daemon_at.is_some() {
            break;
        }
    }
    run.fidelity.damage = feed.damage;
    Ok(run.fidelity)
}

struct Run<'a> {
    machine: &'a mut Machine,
    start: Start,
    settings: Option<&'a BTreeMap<u64, Settings>>,
    subjects: VecDeque<(u64, Settings)>,
    /// Number of the reload whose settings are in use; `None` before the first checkpoint or reload.
    settings_number: Option<u64>,
    /// Whether the memory equals the live loop's, byte for byte.
    exact: bool,
    running: bool,
    last: Option<Tick>,
    suit: Vec<SuitSample>,
    ground: Vec<GroundSample>,
    body: Option<Box<SuitBody>>,
    fidelity: Fidelity,
}

impl Run<'_> {
    /// Replays one cycle; returns whether it gives a state.
    fn cycle(&mut self, feed: &mut Feed<'_>, cycle: &Cycle) -> bool {
        let record = &*cycle.record;
        let tick = Tick { cycle: record.cycle, due_ns: record.due_ns };
        if !self.is_next(tick) {
            return false;
        }
        if !self.reload(record) {
            return false;
        }
        let complete = self.pop_samples(feed, record);
        let checkpoint = cycle.checkpoint.as_deref().filter(|_| self.start == Start::Checkpoint);
        let resume = checkpoint.and_then(Checkpoint::memory);
        if let Some(checkpoint) = checkpoint.filter(|_| resume.is_some())
            && !self.use_settings(checkpoint.settings_number, record.cycle)
        {
            return false;
        }
        // From an empty memory, skip the first cycles, whose samples precede the recording.
        self.running |=
            self.start == Start::Empty && complete && !(self.suit.is_empty() && self.ground.is_empty());
        if !self.running {
            return self.begin(resume);
        }
        let command = match self.begin_subject(tick) {
            true => Some(CommandKind::SubjectLoad),
            false => CommandKind::from_number(record.command),
        };
        let is_command_valid = record.command == 0 || command.is_some();
        if !complete {
            self.fidelity.cycles_lacking_samples += 1;
        }
        if !is_command_valid {
            self.fidelity.unknown_commands += 1;
        }
        // A subject is loaded from a file, so its data are only in a checkpoint of the same cycle.
        let loaded = command == Some(CommandKind::SubjectLoad);
        if !complete || !is_command_valid || loaded {
            self.exact = false;
        }
        let inputs = Inputs { suit: &self.suit, ground: &self.ground, body: self.body.as_deref(), command };
        self.machine.step(tick, inputs);
        self.fidelity.cycles += 1;
        match resume {
            Some(memory) if self.exact => self.fidelity.compare_memory(self.machine.memory(), memory),
            Some(memory) => {
                self.machine.resume(memory);
                self.exact = true;
                self.fidelity.resumed += 1;
            }
            None if self.exact => {}
            None if self.start == Start::Checkpoint => self.fidelity.uncertain_at(tick.cycle),
            None => {}
        }
        if let Some(state) = cycle.state.as_deref().filter(|_| self.exact) {
            self.fidelity.compare_state(self.machine.state(), state);
        }
        if let Some(early) = cycle.early.as_deref().filter(|_| self.exact) {
            self.fidelity.compare_early(self.machine.memory().early(), early);
        }
        true
    }

    /// Begins with a later subject if this is its first cycle; returns whether it is. The data that the daemon loaded from
    /// its profile belong to other settings, so it begins without data.
    fn begin_subject(&mut self, tick: Tick) -> bool {
        let mut begins = false;
        while let Some((_, settings)) = self.subjects.pop_front_if(|(at_ns, _)| *at_ns <= tick.due_ns) {
            self.machine.begin_subject(&settings);
            self.fidelity.other_subject_at.get_or_insert(tick.cycle);
            begins = true;
        }
        begins
    }

    /// Counts gaps and restarts; returns whether to replay the cycle.
    fn is_next(&mut self, tick: Tick) -> bool {
        if let Some(last) = self.last {
            if tick.due_ns <= last.due_ns {
                self.fidelity.out_of_order += 1;
                return false;
            }
            if tick.cycle <= last.cycle {
                self.fidelity.restarts += 1;
                if self.settings.is_some() {
                    // The header contains the previous daemon's configuration; that of the new daemon is not recorded.
                    self.fidelity.unknown_daemon_at = Some(tick.cycle);
                    return false;
                }
            } else if tick.cycle > last.cycle + 1 {
                self.fidelity.cycles_missing += tick.cycle - last.cycle - 1;
                self.exact = false;
            }
        }
        self.last = Some(tick);
        true
    }

    /// Applies the settings of a reload; returns false if they are not in the recording.
    fn reload(&mut self, record: &CycleRecord) -> bool {
        // Number 0, of an earlier release, only removes the similar subject, which its recordings lack.
        let number = record.command_argument[0] as u64;
        if record.command != CommandKind::Reload as u32 || number == 0 {
            return true;
        }
        self.settings_number.get_or_insert(0);
        self.use_settings(number, record.cycle)
    }

    /// Changes to the settings of a reload unless they are in use; returns false if they are not in the recording. The
    /// first number is that of the header's configuration. A checkpoint reveals a reload whose cycle record is missing.
    fn use_settings(&mut self, number: u64, cycle: u64) -> bool {
        let Some(all) = self.settings else { return true };
        let before = *self.settings_number.get_or_insert(number);
        if before == number {
            return true;
        }
        let Some(settings) = all.get(&number) else {
            self.fidelity.unknown_settings_at = Some(cycle);
            return false;
        };
        self.machine.change_settings(settings);
        self.settings_number = Some(number);
        self.fidelity.reloads += 1;
        true
    }

    /// Resumes from the live loop's memory if this cycle has a checkpoint.
    fn begin(&mut self, resume: Option<&Memory>) -> bool {
        self.fidelity.before_checkpoint += 1;
        if let Some(memory) = resume {
            self.machine.resume(memory);
            (self.running, self.exact) = (true, true);
        }
        false
    }

    fn pop_samples(&mut self, feed: &mut Feed<'_>, record: &CycleRecord) -> bool {
        let suit = IngestedSamples {
            first: record.suit_first,
            last: record.suit_last,
            count: record.suit_taken,
            last_sample_time_ns: record.suit_sample_time_ns,
        };
        let ground = IngestedSamples {
            first: record.ground_first,
            last: record.ground_last,
            count: record.ground_taken,
            last_sample_time_ns: record.ground_sample_time_ns,
        };
        let has_suit = feed.suit.pop(suit, &mut self.suit);
        let has_body;
        (self.body, has_body) = feed.pop_body(record.body_published_ns);
        feed.ground.pop(ground, &mut self.ground) && has_suit && has_body
    }
}
