//! Rings of fixed size between the loop and the other threads, used without waiting or allocation.
//!
//! A full ring rejects and counts new entries; no thread ever waits. Boxes circulate: the loop copies into a blank one
//! and passes it on, and a thread that may allocate returns it.

mod ring;

use std::os::fd::{AsFd, OwnedFd};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering, fence};
use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_config::WaitStrategy;
use equipoise_core::cycle::{Checkpoint, Settings, StoredState, SubjectState};
use equipoise_core::message::{CommandKind, CycleRecord, GroundSample, State, SuitBody, SuitSample};
use rustix::event::{EventfdFlags, PollFd, PollFlags, eventfd, poll};

use crate::realtime::prefault;

pub use ring::Ring;

/// A quarter of a second of the fastest suit.
const SUIT_RING: usize = 64;
/// One second of the fastest plate that the loop supports.
const GROUND_RING: usize = 1024;
/// All datagrams of one null pose, which arrive within a millisecond.
const BODY_RING: usize = 8;
/// A quarter of a second of cycles at the highest rate.
const OUTCOME_RING: usize = 1024;
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

/// Samples that ingress refused because their stamps are in the future, which indicates another clock.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Refused {
    /// Suit samples.
    pub suit: u64,
    /// Ground samples.
    pub ground: u64,
    /// How far in the future the last one was.
    pub ahead_ns: u64,
}

/// Result of one cycle.
#[derive(Debug, Clone, Copy)]
pub struct Outcome {
    /// The state.
    pub state: State,
    /// Stamps and inputs.
    pub record: CycleRecord,
}

/// Rings and counters between the loop and the other threads.
#[derive(Debug)]
pub struct Rings {
    /// Ingress to loop.
    pub suit: Ring<Ingested<SuitSample>>,
    /// Ingress to loop.
    pub ground: Ring<Ingested<GroundSample>>,
    /// Ingress to loop, one a cycle.
    pub body: Ring<Ingested<SuitBody>>,
    /// Commands to the loop, one a cycle.
    pub command: Ring<CommandKind>,
    /// The next worker and its number, with the command that loads it.
    pub worker: Ring<(u64, Box<SubjectState>)>,
    /// Empty boxes of workers, returned by the loop.
    pub returned_workers: Ring<Box<SubjectState>>,
    /// New settings for the loop, and the number of their reload.
    pub settings: Ring<(u64, Box<Settings>)>,
    /// Previous settings, returned to a thread that may free them.
    pub returned_settings: Ring<Box<Settings>>,
    /// Blank boxes for copies of the persistent state.
    pub free_copies: Ring<Box<StoredState>>,
    /// Copies of the persistent state for saving, with the number of their worker.
    pub copies: Ring<(u64, Box<StoredState>)>,
    /// Blank checkpoints for the loop.
    pub free_checkpoints: Ring<Box<Checkpoint>>,
    /// Completed checkpoints for egress.
    pub checkpoints: Ring<Box<Checkpoint>>,
    /// Loop to egress.
    pub outcome: Ring<Outcome>,
    outcome_ready: OwnedFd,
    /// Set while egress sleeps or is about to: the thread that clears it must wake egress.
    egress_sleeping: AtomicBool,
    input_dropped: AtomicU64,
    refused: [AtomicU64; 2],
    ahead_ns: AtomicU64,
    output_dropped: AtomicU64,
    last_cycle: AtomicU64,
    stop: AtomicBool,
    loop_running: AtomicBool,
}

impl Rings {
    /// Creates empty rings and blank checkpoints.
    ///
    /// # Errors
    /// The kernel provides no event file descriptor.
    pub fn new() -> std::io::Result<Rings> {
        let free_checkpoints = Ring::new(CHECKPOINTS);
        for _ in 0..CHECKPOINTS {
            let mut checkpoint = bytemuck::zeroed_box();
            // The loop copies into it, so its pages must be resident.
            prefault(&mut *checkpoint);
            let _ = free_checkpoints.push(checkpoint);
        }
        let free_copies = Ring::new(STORED_COPIES);
        for _ in 0..STORED_COPIES {
            let mut copy = bytemuck::zeroed_box();
            prefault(&mut *copy);
            let _ = free_copies.push(copy);
        }
        Ok(Rings {
            suit: Ring::prefaulted(SUIT_RING, Ingested { sample: SuitSample::zeroed(), ingress_ns: 0 }),
            ground: Ring::prefaulted(GROUND_RING, Ingested { sample: GroundSample::zeroed(), ingress_ns: 0 }),
            body: Ring::prefaulted(BODY_RING, Ingested { sample: SuitBody::zeroed(), ingress_ns: 0 }),
            command: Ring::new(COMMAND_RING),
            worker: Ring::new(1),
            returned_workers: Ring::new(RETURNED_WORKERS),
            settings: Ring::new(1),
            returned_settings: Ring::new(RETURNED_SETTINGS),
            free_copies,
            // One more slot than boxes: the loop's final copy fits even if the disk is slow.
            copies: Ring::new(STORED_COPIES + 1),
            free_checkpoints,
            checkpoints: Ring::new(CHECKPOINTS),
            outcome: Ring::prefaulted(
                OUTCOME_RING,
                Outcome { state: State::zeroed(), record: CycleRecord::zeroed() },
            ),
            outcome_ready: eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?,
            egress_sleeping: AtomicBool::new(false),
            input_dropped: AtomicU64::new(0),
            refused: Default::default(),
            ahead_ns: AtomicU64::new(0),
            output_dropped: AtomicU64::new(0),
            last_cycle: AtomicU64::new(0),
            stop: AtomicBool::new(false),
            loop_running: AtomicBool::new(false),
        })
    }

    /// Passes a suit sample to the loop; a full ring rejects it.
    pub fn push_suit(&self, sample: SuitSample, ingress_ns: u64) {
        if self.suit.push(Ingested { sample, ingress_ns }).is_err() {
            self.input_dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Passes a ground sample to the loop; a full ring rejects it.
    pub fn push_ground(&self, sample: GroundSample, ingress_ns: u64) {
        if self.ground.push(Ingested { sample, ingress_ns }).is_err() {
            self.input_dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Passes the wearer's body dimensions to the loop; a full ring rejects them.
    pub fn push_body(&self, sample: SuitBody, ingress_ns: u64) {
        if self.body.push(Ingested { sample, ingress_ns }).is_err() {
            self.input_dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Passes a cycle's outcome to egress and wakes it if it sleeps; a full ring rejects it. No allocation, and a
    /// system call only if egress sleeps.
    pub fn push_outcome(&self, outcome: Outcome) {
        self.last_cycle.store(outcome.state.cycle, Ordering::Relaxed);
        if self.outcome.push(outcome).is_err() {
            self.output_dropped.fetch_add(1, Ordering::Relaxed);
        }
        // Pairs with the fence in [`Self::wait_for_outcome`]: either this thread reads that egress sleeps, or egress
        // reads the outcome.
        fence(Ordering::SeqCst);
        if self.egress_sleeping.swap(false, Ordering::Relaxed) {
            // Writing fails only if the counter is full; egress is woken in that case too.
            let _ = rustix::io::write(&self.outcome_ready, &1_u64.to_ne_bytes());
        }
    }

    /// Passes new settings to the loop and takes back the previous ones; returns whether they were queued. For ordinary
    /// threads: waits until the loop has applied the settings queued before. A running loop applies them within a
    /// cycle.
    pub fn push_settings(&self, number: u64, settings: Box<Settings>) -> bool {
        let mut update = (number, settings);
        for _ in 0..SETTINGS_ATTEMPTS {
            while self.returned_settings.pop().is_some() {}
            match self.settings.push(update) {
                Ok(()) => return true,
                Err(returned) => update = returned,
            }
            std::thread::sleep(SETTINGS_RETRY_DELAY);
        }
        false
    }

    /// Waits for an outcome or until the timeout.
    pub fn await_outcome(&self, wait_strategy: WaitStrategy, timeout: Duration) {
        match wait_strategy {
            WaitStrategy::Sleeping => self.wait_for_outcome(timeout),
            WaitStrategy::Polling => self.poll_for_outcome(timeout),
        }
    }

    /// Sleeps until an outcome is available or until the timeout.
    pub fn wait_for_outcome(&self, timeout: Duration) {
        self.egress_sleeping.store(true, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        if self.outcome.is_empty() {
            self.sleep_for_outcome(timeout);
        }
        self.egress_sleeping.store(false, Ordering::Relaxed);
    }

    fn sleep_for_outcome(&self, timeout: Duration) {
        let timeout = rustix::time::Timespec {
            tv_sec: timeout.as_secs() as i64,
            tv_nsec: i64::from(timeout.subsec_nanos()),
        };
        let mut descriptors = [PollFd::from_borrowed_fd(self.outcome_ready.as_fd(), PollFlags::IN)];
        if poll(&mut descriptors, Some(&timeout)).is_ok_and(|ready| ready > 0) {
            let _ = rustix::io::read(&self.outcome_ready, &mut [0_u8; 8]);
        }
    }

    /// Polls for an outcome without sleeping until the timeout. Uses a full core.
    pub fn poll_for_outcome(&self, timeout: Duration) {
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

    /// Number of input samples rejected by a full ring.
    pub fn input_dropped(&self) -> u64 {
        self.input_dropped.load(Ordering::Relaxed)
    }

    /// Counts a suit sample that is withheld from the loop because its stamps are in the future.
    pub fn refuse_suit(&self, ahead_ns: u64) {
        self.refuse(0, ahead_ns);
    }

    /// Counts such a ground sample.
    pub fn refuse_ground(&self, ahead_ns: u64) {
        self.refuse(1, ahead_ns);
    }

    fn refuse(&self, stream: usize, ahead_ns: u64) {
        self.refused[stream].fetch_add(1, Ordering::Relaxed);
        self.ahead_ns.store(ahead_ns, Ordering::Relaxed);
    }

    /// Samples refused before the loop, since the start.
    pub fn refused(&self) -> Refused {
        let [suit, ground] = [0, 1].map(|stream: usize| self.refused[stream].load(Ordering::Relaxed));
        Refused { suit, ground, ahead_ns: self.ahead_ns.load(Ordering::Relaxed) }
    }

    /// Number of outcomes rejected by a full ring.
    pub fn output_dropped(&self) -> u64 {
        self.output_dropped.load(Ordering::Relaxed)
    }

    /// Number of the newest cycle.
    pub fn last_cycle(&self) -> u64 {
        self.last_cycle.load(Ordering::Relaxed)
    }

    /// Requests all threads to end.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Marks the loop as running until the returned value is dropped, also by a panic; egress runs until then.
    pub fn mark_loop_running(&self) -> impl Drop + use<'_> {
        struct RunningGuard<'a>(&'a AtomicBool);
        impl Drop for RunningGuard<'_> {
            fn drop(&mut self) {
                self.0.store(false, Ordering::Release);
            }
        }
        self.loop_running.store(true, Ordering::Release);
        RunningGuard(&self.loop_running)
    }

    /// Whether the loop will produce no more outcomes: a stop was requested, and the loop has ended or never started.
    pub fn has_ended(&self) -> bool {
        self.is_stopping() && !self.loop_running.load(Ordering::Acquire)
    }

    /// Whether a stop was requested.
    pub fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn outcome(cycle: u64) -> Outcome {
        Outcome { state: State { cycle, ..State::zeroed() }, record: CycleRecord::zeroed() }
    }

    #[test]
    fn no_wakeup_is_lost_and_an_awake_egress_gets_none() {
        let rings = std::sync::Arc::new(Rings::new().unwrap());
        let pending = || {
            let mut descriptors = [PollFd::from_borrowed_fd(rings.outcome_ready.as_fd(), PollFlags::IN)];
            poll(&mut descriptors, Some(&rustix::time::Timespec { tv_sec: 0, tv_nsec: 0 })).unwrap()
        };
        rings.push_outcome(outcome(1));
        assert_eq!(pending(), 0, "egress was awake");
        assert!(rings.outcome.pop().is_some());

        const CYCLES: u64 = 20_000;
        let egress = std::thread::spawn({
            let rings = std::sync::Arc::clone(&rings);
            move || {
                let mut received = 0;
                while received < CYCLES {
                    // A lost wake-up would make this sleep last for an hour.
                    rings.wait_for_outcome(Duration::from_secs(3600));
                    while rings.outcome.pop().is_some() {
                        received += 1;
                    }
                }
            }
        });
        for cycle in 1..=CYCLES {
            while rings.outcome.is_full() {
                std::thread::yield_now();
            }
            rings.push_outcome(outcome(cycle));
            if cycle % 7 == 0 {
                std::thread::yield_now();
            }
        }
        egress.join().unwrap();
        assert_eq!(rings.output_dropped(), 0);
    }

    #[test]
    fn a_polling_egress_receives_every_outcome_without_wakeups() {
        const CYCLES: u64 = 2_000;
        let rings = std::sync::Arc::new(Rings::new().unwrap());
        let egress = std::thread::spawn({
            let rings = std::sync::Arc::clone(&rings);
            move || {
                let mut received = 0;
                while received < CYCLES {
                    rings.await_outcome(WaitStrategy::Polling, Duration::from_millis(50));
                    received += std::iter::from_fn(|| rings.outcome.pop()).count() as u64;
                }
            }
        });
        for cycle in 1..=CYCLES {
            while rings.outcome.is_full() {
                std::thread::yield_now();
            }
            rings.push_outcome(outcome(cycle));
        }
        egress.join().unwrap();
        let mut descriptors = [PollFd::from_borrowed_fd(rings.outcome_ready.as_fd(), PollFlags::IN)];
        let now = rustix::time::Timespec { tv_sec: 0, tv_nsec: 0 };
        assert_eq!(poll(&mut descriptors, Some(&now)).unwrap(), 0, "an awakening was paid for");
    }
}
