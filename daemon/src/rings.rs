//! Rings of fixed size between the loop and the other threads, used without waiting or allocation.
//!
//! **Which queue, and why.** Rings from and to the loop, and from egress to the latency log, are `rtrb`: one producer,
//! one consumer, and neither end ever waits. In a queue for several producers or consumers, one thread can spin until
//! another, preempted in the middle of a push or pop, continues; the loop has the highest priority and would spin
//! forever for a thread that it has displaced from the core. Threads that are not real-time use `crossbeam-channel`
//! among themselves: it may lock, allocate and sleep, and wakes the receiver.
//!
//! **Ownership.** Each end is a value that one thread owns: [`Rings::new`] returns the ends of each thread as one
//! struct, which `pipeline` moves into the thread, so that no end needs a lock. Only [`SettingsSender`] belongs to two
//! threads, neither of which is real-time: it is in the lock that serialises changes of the configuration.
//!
//! **End of a thread.** No thread that owns ends is restarted: its end stops the daemon. The adapters, which are
//! restarted, publish on the bus and own no end. An end that is dropped takes nothing from the other one: the ring
//! stays empty, or fills up and rejects, and the loop continues to its last cycle without waiting.
//!
//! A full ring rejects and counts new entries. Boxes circulate: the loop copies into a blank one and passes it on, and
//! a thread that may allocate returns it.

mod control;
mod wake_up;

use std::sync::Arc;
use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use equipoise_config::WaitStrategy;
use equipoise_core::cycle::{Checkpoint, Settings, StoredState, SubjectState};
use equipoise_core::message::{
    CommandKind, CycleRecord, EarlyState, GroundSample, State, SuitBody, SuitSample,
};
use rtrb::{Consumer, Producer, RingBuffer};

use crate::realtime::prefault;

pub use control::{LoopControl, Refused, Tares};
use wake_up::WakeUp;

/// A quarter of a second of the fastest suit.
const SUIT_RING: usize = 64;
/// One second of the fastest plate that the loop supports.
const GROUND_RING: usize = 1024;
/// All datagrams of one null pose, which arrive within a millisecond.
const BODY_RING: usize = 8;
/// A quarter of a second of cycles at the highest rate.
const OUTCOME_RING: usize = 1024;
/// A quarter of a second of the fastest suit.
const EARLY_RING: usize = 64;
const COMMAND_RING: usize = 16;
/// One more than the maximum number of pending commands: the ring is never full, so the loop never frees a worker.
const RETURNED_WORKERS: usize = COMMAND_RING + 1;
const CHECKPOINTS: usize = 2;
/// One being written to disk, one of the previous worker, one of the current worker, one spare.
const STORED_COPIES: usize = 4;
/// Number of boxes reserved for the final copy of a worker that is replaced: periodic copies can wait.
pub const RESERVED_FOR_SHUTDOWN: usize = 1;
/// The sender of settings empties the ring first: it is never full, so the loop never frees settings.
const RETURNED_SETTINGS: usize = 4;

/// Total waiting time equals ten cycles of a loop at 100 Hz.
const SETTINGS_ATTEMPTS: u32 = 100;
const SETTINGS_RETRY_DELAY: Duration = Duration::from_millis(1);

/// A sample and the time at which ingress received it: the stamp is for the cycle record only and not an input of the
/// cycle, so a replay, which has no ingress, gives the same result.
#[derive(Debug, Clone, Copy)]
pub struct Ingested<S> {
    /// The sample as it was published.
    pub sample: S,
    /// Time of receipt by ingress, CLOCK_MONOTONIC.
    pub ingress_ns: u64,
}

/// Result of one cycle.
#[derive(Debug, Clone, Copy)]
pub struct Outcome {
    /// The state.
    pub state: State,
    /// Stamps and inputs.
    pub record: CycleRecord,
}

/// All ends of the rings, grouped by the thread that owns them, and what these threads share.
pub struct Rings {
    /// Flags and counters, for all threads.
    pub control: Arc<LoopControl>,
    /// Ends of the loop.
    pub loop_ends: LoopEnds,
    /// Ends of ingress.
    pub ingress: IngressEnds,
    /// Ends of egress.
    pub egress: EgressEnds,
    /// Ends of the saving thread.
    pub saving: SavingEnds,
    /// Ends of the command thread.
    pub commands: CommandEnds,
    /// Ends of the thread that holds the lock of changes.
    pub settings: SettingsSender,
}

/// Ends owned by the loop.
pub struct LoopEnds {
    /// Flags and counters.
    pub control: Arc<LoopControl>,
    /// Suit samples.
    pub suit: Consumer<Ingested<SuitSample>>,
    /// Ground samples.
    pub ground: Consumer<Ingested<GroundSample>>,
    /// Body dimensions, one a cycle.
    pub body: Consumer<Ingested<SuitBody>>,
    /// Commands, one a cycle.
    pub command: Consumer<CommandKind>,
    /// The next worker and its number, with the command that loads it.
    pub worker: Consumer<(u64, Box<SubjectState>)>,
    /// Boxes of workers that were copied.
    pub returned_workers: Producer<Box<SubjectState>>,
    /// New settings, and the number of their reload.
    pub settings: Consumer<(u64, Box<Settings>)>,
    /// Previous settings.
    pub returned_settings: Producer<Box<Settings>>,
    /// Blank boxes for copies of the persistent state.
    pub free_copies: Consumer<Box<StoredState>>,
    /// Copies of the persistent state, with the number of their worker.
    pub copies: Producer<(u64, Box<StoredState>)>,
    /// Blank checkpoints.
    pub free_checkpoints: Consumer<Box<Checkpoint>>,
    /// Completed checkpoints.
    pub checkpoints: Producer<Box<Checkpoint>>,
    early: Producer<EarlyState>,
    outcome: Producer<Outcome>,
    output_dropped: u64,
    wake_up: Arc<WakeUp>,
}

/// Ends owned by ingress.
#[derive(Debug)]
pub struct IngressEnds {
    /// Flags and counters.
    pub control: Arc<LoopControl>,
    suit: Producer<Ingested<SuitSample>>,
    ground: Producer<Ingested<GroundSample>>,
    body: Producer<Ingested<SuitBody>>,
}

/// Ends owned by egress.
pub struct EgressEnds {
    /// Flags and counters.
    pub control: Arc<LoopControl>,
    /// Early states of the outcomes' cycles; not every cycle has one.
    pub early: Consumer<EarlyState>,
    /// Results of cycles.
    pub outcome: Consumer<Outcome>,
    /// Completed checkpoints.
    pub checkpoints: Consumer<Box<Checkpoint>>,
    /// Returns blank checkpoints to the loop.
    pub free_checkpoints: Producer<Box<Checkpoint>>,
    wake_up: Arc<WakeUp>,
}

/// Ends owned by the saving thread.
#[derive(Debug)]
pub struct SavingEnds {
    /// Flags and counters.
    pub control: Arc<LoopControl>,
    /// Copies of the persistent state, with the number of their worker.
    pub copies: Consumer<(u64, Box<StoredState>)>,
    /// Returns blank boxes to the loop.
    pub free_copies: Producer<Box<StoredState>>,
}

/// Ends owned by the command thread.
#[derive(Debug)]
pub struct CommandEnds {
    /// Flags and counters.
    pub control: Arc<LoopControl>,
    /// Commands to the loop.
    pub command: Producer<CommandKind>,
    /// The next worker and its number, with the command that loads it.
    pub worker: Producer<(u64, Box<SubjectState>)>,
    /// Boxes of workers, returned by the loop, to be freed here.
    pub returned_workers: Consumer<Box<SubjectState>>,
}

/// Passes settings to the loop; owned by the thread that changes the configuration.
#[derive(Debug)]
pub struct SettingsSender {
    /// New settings, and the number of their reload.
    pub settings: Producer<(u64, Box<Settings>)>,
    /// Previous settings, returned by the loop, to be freed here.
    pub returned: Consumer<Box<Settings>>,
}

impl Rings {
    /// Creates empty rings and blank boxes.
    ///
    /// # Errors
    /// The kernel provides no event file descriptor.
    pub fn new() -> std::io::Result<Rings> {
        let control = Arc::new(LoopControl::default());
        let wake_up = Arc::new(WakeUp::new()?);
        let (ingress, InputEnds { suit, ground, body }) = input_rings(&control);
        let (command_in, command) = RingBuffer::new(COMMAND_RING);
        let (worker_in, worker) = RingBuffer::new(1);
        let (returned_workers, returned_workers_out) = RingBuffer::new(RETURNED_WORKERS);
        let (settings_in, settings) = RingBuffer::new(1);
        let (returned_settings, returned_settings_out) = RingBuffer::new(RETURNED_SETTINGS);
        let (free_copies_in, free_copies) = blank_boxes(STORED_COPIES);
        // One more slot than boxes: the loop's final copy fits even if the disk is slow.
        let (copies, copies_out) = RingBuffer::new(STORED_COPIES + 1);
        let (free_checkpoints_in, free_checkpoints) = blank_boxes(CHECKPOINTS);
        let (checkpoints, checkpoints_out) = RingBuffer::new(CHECKPOINTS);
        let (early, early_out) = prefaulted(EARLY_RING, EarlyState::zeroed());
        let (outcome, outcome_out) =
            prefaulted(OUTCOME_RING, Outcome { state: State::zeroed(), record: CycleRecord::zeroed() });
        Ok(Rings {
            loop_ends: LoopEnds {
                control: Arc::clone(&control),
                suit,
                ground,
                body,
                command,
                worker,
                returned_workers,
                settings,
                returned_settings,
                free_copies,
                copies,
                free_checkpoints,
                checkpoints,
                early,
                outcome,
                output_dropped: 0,
                wake_up: Arc::clone(&wake_up),
            },
            ingress,
            egress: EgressEnds {
                control: Arc::clone(&control),
                early: early_out,
                outcome: outcome_out,
                checkpoints: checkpoints_out,
                free_checkpoints: free_checkpoints_in,
                wake_up,
            },
            saving: SavingEnds {
                control: Arc::clone(&control),
                copies: copies_out,
                free_copies: free_copies_in,
            },
            commands: CommandEnds {
                control: Arc::clone(&control),
                command: command_in,
                worker: worker_in,
                returned_workers: returned_workers_out,
            },
            settings: SettingsSender { settings: settings_in, returned: returned_settings_out },
            control,
        })
    }
}

/// Ends owned by the loop of the rings from ingress.
struct InputEnds {
    suit: Consumer<Ingested<SuitSample>>,
    ground: Consumer<Ingested<GroundSample>>,
    body: Consumer<Ingested<SuitBody>>,
}

/// Empty rings from ingress to the loop.
fn input_rings(control: &Arc<LoopControl>) -> (IngressEnds, InputEnds) {
    let (suit_in, suit) = ingested(SUIT_RING);
    let (ground_in, ground) = ingested(GROUND_RING);
    let (body_in, body) = ingested(BODY_RING);
    let control = Arc::clone(control);
    let ingress = IngressEnds { control, suit: suit_in, ground: ground_in, body: body_in };
    (ingress, InputEnds { suit, ground, body })
}

/// An empty ring of samples.
fn ingested<S: Pod>(capacity: usize) -> (Producer<Ingested<S>>, Consumer<Ingested<S>>) {
    prefaulted(capacity, Ingested { sample: S::zeroed(), ingress_ns: 0 })
}

/// An empty ring whose memory was touched completely, so that its first use causes no page faults.
fn prefaulted<T: Copy>(capacity: usize, example: T) -> (Producer<T>, Consumer<T>) {
    let (mut producer, mut consumer) = RingBuffer::new(capacity);
    while producer.push(example).is_ok() {}
    while consumer.pop().is_ok() {}
    (producer, consumer)
}

/// A ring full of blank boxes. The loop copies into them, so their pages must be resident.
fn blank_boxes<T: Pod>(capacity: usize) -> (Producer<Box<T>>, Consumer<Box<T>>) {
    let (mut producer, consumer) = RingBuffer::new(capacity);
    while !producer.is_full() {
        let mut blank = bytemuck::zeroed_box();
        prefault(&mut *blank);
        let _ = producer.push(blank);
    }
    (producer, consumer)
}

impl LoopEnds {
    /// Passes a new early state to egress, before the outcome of its cycle; a full ring rejects it.
    pub fn push_early(&mut self, early: EarlyState) {
        if self.early.push(early).is_err() {
            self.output_dropped += 1;
        }
    }

    /// Passes a cycle's outcome to egress and wakes it if it sleeps; a full ring rejects it. No allocation, and a
    /// system call only if egress sleeps.
    pub fn push_outcome(&mut self, outcome: Outcome) {
        self.control.set_last_cycle(outcome.state.cycle);
        if self.outcome.push(outcome).is_err() {
            self.output_dropped += 1;
        }
        self.wake_up.wake();
    }

    /// Number of outcomes and early states rejected by a full ring.
    pub fn output_dropped(&self) -> u64 {
        self.output_dropped
    }
}

impl IngressEnds {
    /// Passes a suit sample to the loop; a full ring rejects it.
    pub fn push_suit(&mut self, sample: SuitSample, ingress_ns: u64) {
        if self.suit.push(Ingested { sample, ingress_ns }).is_err() {
            self.control.count_dropped_input();
        }
    }

    /// Passes a ground sample to the loop; a full ring rejects it.
    pub fn push_ground(&mut self, sample: GroundSample, ingress_ns: u64) {
        if self.ground.push(Ingested { sample, ingress_ns }).is_err() {
            self.control.count_dropped_input();
        }
    }

    /// Passes the wearer's body dimensions to the loop; a full ring rejects them.
    pub fn push_body(&mut self, sample: SuitBody, ingress_ns: u64) {
        if self.body.push(Ingested { sample, ingress_ns }).is_err() {
            self.control.count_dropped_input();
        }
    }
}

impl EgressEnds {
    /// Waits for an outcome or until the timeout.
    pub fn await_outcome(&self, wait_strategy: WaitStrategy, timeout: Duration) {
        match wait_strategy {
            WaitStrategy::Sleeping => self.wake_up.sleep(|| !self.outcome.is_empty(), timeout),
            WaitStrategy::Polling => self.poll_for_outcome(timeout),
        }
    }

    /// Uses a full core.
    fn poll_for_outcome(&self, timeout: Duration) {
        let started = std::time::Instant::now();
        // Reading the clock costs more than checking the ring.
        while started.elapsed() < timeout {
            for _ in 0..64 {
                if !self.outcome.is_empty() {
                    return;
                }
                std::hint::spin_loop();
            }
        }
    }
}

impl SettingsSender {
    /// Frees the settings that the loop has replaced, and waits until it has applied those queued before, which a running
    /// loop does within a cycle. Returns whether a slot is free; it stays free until [`SettingsSender::send`].
    pub fn wait_for_slot(&mut self) -> bool {
        for _ in 0..SETTINGS_ATTEMPTS {
            self.free_returned();
            if !self.settings.is_full() {
                return true;
            }
            // The loop makes no system call to report a free slot.
            std::thread::sleep(SETTINGS_RETRY_DELAY);
        }
        false
    }

    /// Passes new settings to the loop; returns whether a slot was free.
    pub fn send(&mut self, number: u64, settings: Box<Settings>) -> bool {
        self.settings.push((number, settings)).is_ok()
    }

    /// Frees the settings that the loop has replaced.
    pub fn free_returned(&mut self) {
        while self.returned.pop().is_ok() {}
    }
}

#[cfg(test)]
mod tests;
