//! The loop: wakes on an absolute schedule, ingests pending samples, executes one cycle, and passes the results on.
//!
//! It owns no port of the bus, because joining and leaving participants would cause allocations and system calls. While
//! running it does not allocate, lock or format, and makes system calls only to sleep and to wake egress. See
//! [`Loop::run`].

mod clock;
mod deadlines;

use equipoise_core::cycle::{Identification, Inputs, Memory, Settings, StoredState, Tick, step};
use equipoise_core::message::{CommandKind, CycleRecord, GroundSample, SuitSample};
use equipoise_core::time::NS_PER_S;
use rtrb::Consumer;

use crate::realtime::prefault;
use crate::rings::{Ingested, LoopEnds, Outcome, RESERVED_FOR_SHUTDOWN};
use crate::schedule::Schedule;

pub use clock::{Clock, Monotonic};
pub use deadlines::{LoopSummary, Miss, Misses};

/// Maximum number of samples ingested per cycle; the rest stays in the ring.
const SUIT_SAMPLES_MAX: usize = 8;
const GROUND_SAMPLES_MAX: usize = 64;
/// Interval of copies of the persistent state, which are also made with every command: including the disk's latency, a
/// kill loses less than a second.
const COPY_INTERVAL_NS: u64 = NS_PER_S / 2;

/// Called in every cycle from inside the loop, for counters in tests.
pub trait Observer: Send {
    /// Called at the end of the sleep.
    fn cycle_begins(&mut self, _cycle: u64) {}
    /// Called after the outcome is passed on.
    fn cycle_ends(&mut self, _cycle: u64) {}
}

/// Does nothing.
#[derive(Debug)]
pub struct NoObserver;
impl Observer for NoObserver {}

/// The loop before it runs.
pub struct Loop {
    settings: Settings,
    memory: Box<Memory>,
    ends: LoopEnds,
    suit: Box<[SuitSample; SUIT_SAMPLES_MAX]>,
    ground: Box<[GroundSample; GROUND_SAMPLES_MAX]>,
    record: CycleRecord,
    /// A checkpoint is due and is copied once a free one is available.
    checkpoint_due: bool,
    checkpointed: IdentificationProgress,
    /// Number of the worker in `memory`.
    worker: u64,
    /// Number of the reload whose settings are in use; 0 for those of the start.
    settings_number: u64,
    /// Time of the last copy of the persistent state in `memory`.
    copied_ns: u64,
    /// A copy is due and is made once a free one is available.
    copy_due: bool,
}

/// Subject data at the last checkpoint.
#[derive(Clone, Copy, PartialEq, Eq)]
struct IdentificationProgress {
    poses_used: u64,
    learning: u64,
    identified: u64,
    has_mass: bool,
}

impl IdentificationProgress {
    fn of(worker: &Identification) -> IdentificationProgress {
        IdentificationProgress {
            poses_used: worker.poses_used,
            learning: worker.identifying,
            identified: worker.identified,
            has_mass: worker.mass_kg > 0.0,
        }
    }
}

impl Loop {
    /// Creates a loop with an initialised or restored memory.
    ///
    /// `worker` is the number of its worker.
    pub fn new(settings: Settings, memory: Box<Memory>, worker: u64, ends: LoopEnds, period_ns: u64) -> Loop {
        let checkpointed = IdentificationProgress::of(&memory.identification);
        let record = CycleRecord { period_ns, ..bytemuck::Zeroable::zeroed() };
        let mut new = Loop {
            settings,
            memory,
            ends,
            suit: bytemuck::zeroed_box(),
            ground: bytemuck::zeroed_box(),
            record,
            checkpoint_due: true,
            checkpointed,
            worker,
            settings_number: 0,
            copied_ns: 0,
            copy_due: false,
        };
        // Fresh memory is mapped page by page at the first access: access it here to avoid page faults in a cycle.
        prefault(&mut *new.memory);
        prefault(&mut *new.suit);
        prefault(&mut *new.ground);
        new
    }

    /// Runs until [`LoopControl::stop`](crate::rings::LoopControl::stop).
    pub fn run(mut self, clock: &mut impl Clock, observer: &mut dyn Observer) -> LoopSummary {
        let period_ns = self.record.period_ns;
        let mut schedule = Schedule::new(clock.now_ns() + period_ns, period_ns);
        let (mut cycle, mut ended_ns, mut misses) = (0, 0, Misses::default());
        while !self.ends.control.is_stopping() {
            clock.sleep_until(schedule.due_ns());
            let woken_ns = clock.now_ns();
            cycle += 1;
            observer.cycle_begins(cycle);

            let command = self.command();
            if command == Some(CommandKind::Tare) {
                self.ends.control.count_tare(self.memory.can_tare());
            }
            let (suit, ground) = self.pop_samples();
            let body = self.ends.body.pop().ok().map(|ingested| ingested.sample);
            let tick = Tick { cycle, due_ns: schedule.due_ns() };
            let (suits, grounds) = (&self.suit[..suit], &self.ground[..ground]);
            let inputs = Inputs { suit: suits, ground: grounds, body: body.as_ref(), command };
            let compute_start_ns = clock.now_ns();
            let state = *step(&self.settings, &mut self.memory, tick, inputs);
            let compute_end_ns = clock.now_ns();

            self.record_stamps(tick, [woken_ns, compute_start_ns, compute_end_ns]);
            self.record_lateness(&schedule, misses.check(cycle, compute_end_ns, schedule.deadline_ns()));
            self.record_inputs(suit, ground, command);
            self.record.body_published_ns = body.map_or(0, |body| body.published_ns);
            if self.memory.early().cycle == cycle {
                self.ends.push_early(*self.memory.early());
            }
            self.ends.push_outcome(Outcome { state, record: self.record });
            self.take_checkpoint(cycle, command);
            self.push_copy_if_due(tick.due_ns, command);

            observer.cycle_ends(cycle);
            ended_ns = clock.now_ns();
            schedule.advance(ended_ns);
        }
        self.push_final_copy();
        LoopSummary::of(cycle, misses, &schedule, ended_ns)
    }

    fn record_stamps(&mut self, tick: Tick, [woken_ns, compute_start_ns, compute_end_ns]: [u64; 3]) {
        let record = &mut self.record;
        (record.cycle, record.due_ns) = (tick.cycle, tick.due_ns);
        (record.woken_ns, record.compute_start_ns, record.compute_end_ns) =
            (woken_ns, compute_start_ns, compute_end_ns);
    }

    fn record_lateness(&mut self, schedule: &Schedule, missed: bool) {
        self.record.slots_skipped = schedule.slots_skipped();
        self.record.deadline_missed = u32::from(missed);
        self.record.deadlines_missed += u64::from(missed);
    }

    fn pop_samples(&mut self) -> (usize, usize) {
        let (suit, ground) = (&mut self.suit[..], &mut self.ground[..]);
        let suit_taken = pop_into(suit, &mut self.record.suit_ingress_ns, &mut self.ends.suit);
        let ground_taken = pop_into(ground, &mut self.record.ground_ingress_ns, &mut self.ends.ground);
        (suit_taken, ground_taken)
    }

    fn record_inputs(&mut self, suit_taken: usize, ground_taken: usize, command: Option<CommandKind>) {
        let (suit, ground, record) =
            (&self.suit[..suit_taken], &self.ground[..ground_taken], &mut self.record);
        record.command = command.map_or(0, |command| command as u32);
        record.input_dropped = self.ends.control.input_dropped();
        let refused = self.ends.control.refused();
        record.input_refused = self.memory.rejected_samples() + refused.suit + refused.ground;
        record.output_dropped = self.ends.output_dropped();
        record.suit_taken = suit_taken as u32;
        record.ground_taken = ground_taken as u32;
        record.suit_first = suit.first().map_or(0, |sample| sample.sequence);
        record.suit_last = suit.last().map_or(0, |sample| sample.sequence);
        record.ground_first = ground.first().map_or(0, |sample| sample.sequence);
        record.ground_last = ground.last().map_or(0, |sample| sample.sequence);
        if let Some(newest) = suit.last() {
            record.suit_sample_time_ns = newest.sample_time_ns;
            record.suit_arrival_ns = newest.arrival_ns;
            record.suit_published_ns = newest.published_ns;
        }
        if let Some(newest) = ground.last() {
            record.ground_sample_time_ns = newest.sample_time_ns;
            record.ground_arrival_ns = newest.arrival_ns;
            record.ground_published_ns = newest.published_ns;
        }
    }

    /// The command of this cycle; applies the worker or settings that accompany it. The emptied box returns to a thread
    /// that may free it.
    fn command(&mut self) -> Option<CommandKind> {
        self.record.command_argument = [0.0; 4];
        let command = self.ends.command.pop().ok();
        if command == Some(CommandKind::SubjectLoad) && !self.ends.worker.is_empty() {
            self.memory.exposure.end_lift();
            // Final copy of the previous worker; before the worker's slot is free, which the command thread checks.
            self.push_copy();
        }
        if command == Some(CommandKind::SubjectLoad)
            && let Ok((number, worker)) = self.ends.worker.pop()
        {
            self.memory.replace_subject(&worker);
            self.worker = number;
            let _ = self.ends.returned_workers.push(worker);
        }
        if command.is_none()
            && let Ok((number, mut settings)) = self.ends.settings.pop()
        {
            std::mem::swap(&mut self.settings, &mut *settings);
            self.settings_number = number;
            let _ = self.ends.returned_settings.push(settings);
            self.record.command_argument[0] = number as f64;
            return Some(CommandKind::Reload);
        }
        command
    }

    fn push_copy_if_due(&mut self, due_ns: u64, command: Option<CommandKind>) {
        self.copy_due |= command.is_some() || due_ns.saturating_sub(self.copied_ns) >= COPY_INTERVAL_NS;
        // Waiting for a slow disk loses nothing: the worker stays in memory.
        if self.copy_due && self.ends.free_copies.slots() > RESERVED_FOR_SHUTDOWN {
            (self.copy_due, self.copied_ns) = (false, due_ns);
            self.push_copy();
        }
    }

    /// Copies the persistent state if a box is blank.
    fn push_copy(&mut self) {
        if let Ok(copy) = self.ends.free_copies.pop() {
            self.fill_and_push(copy);
        }
    }

    /// As [`Self::push_copy`], but always: after the last cycle an allocation is harmless.
    fn push_final_copy(&mut self) {
        let copy = self.ends.free_copies.pop().unwrap_or_else(|_| bytemuck::zeroed_box());
        self.fill_and_push(copy);
    }

    fn fill_and_push(&mut self, mut copy: Box<StoredState>) {
        copy.copy_from(&self.memory, &self.settings);
        self.ends.control.count_copy();
        // Cannot fail: there are more slots than boxes.
        let _ = self.ends.copies.push((self.worker, copy));
    }

    fn take_checkpoint(&mut self, cycle: u64, command: Option<CommandKind>) {
        let worker = IdentificationProgress::of(&self.memory.identification);
        self.checkpoint_due |= worker != self.checkpointed || command.is_some();
        if self.checkpoint_due
            && let Ok(mut checkpoint) = self.ends.free_checkpoints.pop()
        {
            checkpoint.take(cycle, &self.memory);
            checkpoint.settings_number = self.settings_number;
            self.checkpoint_due = false;
            self.checkpointed = worker;
            // Cannot fail: the ring has as many slots as there are boxes.
            let _ = self.ends.checkpoints.push(checkpoint);
        }
    }
}

/// Returns the number of samples; `ingress_ns` is set to the stamp of the last.
fn pop_into<S>(slots: &mut [S], ingress_ns: &mut u64, ring: &mut Consumer<Ingested<S>>) -> usize {
    let mut popped = 0;
    while popped < slots.len()
        && let Ok(next) = ring.pop()
    {
        slots[popped] = next.sample;
        *ingress_ns = next.ingress_ns;
        popped += 1;
    }
    popped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rings::{CommandEnds, Rings, SavingEnds, Tares};
    use equipoise_core::cycle::SubjectState;

    const LOAD_AT: u64 = 1000;

    /// Runs its cycles without waiting, loads another worker in the middle, and ends.
    struct Steps {
        now_ns: u64,
        cycle: u64,
        commands: CommandEnds,
        saving: SavingEnds,
        free_before_and_after: [usize; 2],
    }

    impl Steps {
        fn free_copies(&self) -> usize {
            let returned = &self.saving.free_copies;
            returned.buffer().capacity() - returned.slots()
        }
    }

    impl Clock for Steps {
        fn now_ns(&mut self) -> u64 {
            self.now_ns += 10;
            self.now_ns
        }

        fn sleep_until(&mut self, due_ns: u64) {
            (self.now_ns, self.cycle) = (due_ns, self.cycle + 1);
            if self.cycle == LOAD_AT / 2 {
                self.commands.command.push(CommandKind::Tare).unwrap();
            }
            if self.cycle == LOAD_AT {
                let worker = bytemuck::zeroed_box::<SubjectState>();
                assert!(self.commands.worker.push((1, worker)).is_ok());
                self.commands.command.push(CommandKind::SubjectLoad).unwrap();
                self.free_before_and_after[0] = self.free_copies();
            }
            if self.cycle == LOAD_AT + 1 {
                self.free_before_and_after[1] = self.free_copies();
            }
            if self.cycle == 2 * LOAD_AT {
                self.commands.control.stop();
            }
        }
    }

    #[test]
    fn the_final_copy_is_pushed_while_a_disk_write_blocks() {
        let Rings { loop_ends, commands, saving, .. } = Rings::new().unwrap();
        let settings = Settings::for_height(1.77);
        let mut memory = bytemuck::zeroed_box::<Memory>();
        memory.start(&settings);
        let mut clock = Steps { now_ns: 0, cycle: 0, commands, saving, free_before_and_after: [9; 2] };
        // 20 s at 100 Hz, and no box is returned.
        let the_loop = Loop::new(settings, memory, 0, loop_ends, 10_000_000);
        the_loop.run(&mut clock, &mut NoObserver);
        assert_eq!(clock.free_before_and_after, [1, 0], "what is kept now and then leaves one");
        assert_eq!(clock.commands.control.tares(), Tares { tared: 0, refused: 1 }, "no plate");
        assert_eq!(clock.commands.control.copies_pending(), 5);
        let copies = std::iter::from_fn(|| clock.saving.copies.pop().ok());
        let copy: Vec<u64> = copies.map(|(number, _)| number).collect();
        assert_eq!(copy, [0, 0, 0, 0, 1], "the exchanged one's and the end's");
    }
}
