//! Flags and counters of the loop that several threads read.

use std::convert::Infallible;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crossbeam_channel::{Receiver, Sender, bounded};
use crossbeam_utils::CachePadded;

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

/// Number of commands to tare the plate, by their result in the loop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tares {
    /// Applied.
    pub tared: u64,
    /// Without effect: the plate was loaded or faulty.
    pub refused: u64,
}

/// Stop request, state and counters of the loop.
///
/// Grouped by the thread that writes them, one cache line each: under `loop.busy_poll` other threads read `stop`
/// all the time, and would otherwise take the line of the loop's counter from it in every cycle.
#[derive(Debug, Default)]
pub struct LoopControl {
    /// Rarely written.
    run: CachePadded<RunFlags>,
    /// Written by the loop in every cycle.
    last_cycle: CachePadded<AtomicU64>,
    /// Written by the loop after a command.
    tares: CachePadded<[AtomicU64; 2]>,
    /// Copies of the persistent state that are not processed yet: counted up by the loop, down by the saving thread.
    copies: CachePadded<AtomicU64>,
    /// Written by ingress.
    rejected: CachePadded<RejectedInput>,
    stopping: Signal,
    ended: Signal,
}

/// Wakes all waiting threads once: a channel without messages that is closed. The loop only uses the flags.
#[derive(Debug)]
struct Signal {
    open: Mutex<Option<Sender<Infallible>>>,
    closed: Receiver<Infallible>,
}

impl Default for Signal {
    fn default() -> Signal {
        let (open, closed) = bounded(0);
        Signal { open: Mutex::new(Some(open)), closed }
    }
}

impl Signal {
    fn send(&self) {
        *self.open.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

#[derive(Debug, Default)]
struct RunFlags {
    stop: AtomicBool,
    loop_running: AtomicBool,
}

#[derive(Debug, Default)]
struct RejectedInput {
    dropped: AtomicU64,
    refused_suit: AtomicU64,
    refused_ground: AtomicU64,
    ahead_ns: AtomicU64,
}

impl LoopControl {
    /// Requests all threads to end.
    pub fn stop(&self) {
        // Sequentially consistent, as is the end of the loop: at least one of both threads reads the other's flag.
        self.run.stop.store(true, Ordering::SeqCst);
        self.stopping.send();
        self.signal_end();
    }

    fn signal_end(&self) {
        if self.run.stop.load(Ordering::SeqCst) && !self.run.loop_running.load(Ordering::SeqCst) {
            self.ended.send();
        }
    }

    /// Disconnected once a stop was requested; for threads that wait, which the loop does not.
    pub fn stopping(&self) -> &Receiver<Infallible> {
        &self.stopping.closed
    }

    /// Disconnected once [`Self::has_ended`]; for threads that wait.
    pub fn ended(&self) -> &Receiver<Infallible> {
        &self.ended.closed
    }

    /// Whether a stop was requested.
    pub fn is_stopping(&self) -> bool {
        self.run.stop.load(Ordering::Relaxed)
    }

    /// Marks the loop as running until the returned value is dropped, also by a panic; egress runs until then.
    pub fn mark_loop_running(&self) -> impl Drop + use<'_> {
        struct RunningGuard<'a>(&'a LoopControl);
        impl Drop for RunningGuard<'_> {
            fn drop(&mut self) {
                self.0.run.loop_running.store(false, Ordering::SeqCst);
                self.0.signal_end();
            }
        }
        self.run.loop_running.store(true, Ordering::Release);
        RunningGuard(self)
    }

    /// Whether the loop will produce no more outcomes: a stop was requested, and the loop has ended or never started.
    pub fn has_ended(&self) -> bool {
        self.is_stopping() && !self.run.loop_running.load(Ordering::Acquire)
    }

    /// Number of the newest cycle.
    pub fn last_cycle(&self) -> u64 {
        self.last_cycle.load(Ordering::Relaxed)
    }

    pub(super) fn set_last_cycle(&self, cycle: u64) {
        self.last_cycle.store(cycle, Ordering::Relaxed);
    }

    /// Results of the commands to tare.
    pub fn tares(&self) -> Tares {
        let [tared, refused] = [0, 1].map(|index: usize| self.tares[index].load(Ordering::Relaxed));
        Tares { tared, refused }
    }

    /// Counts a command to tare by its result.
    pub fn count_tare(&self, is_tared: bool) {
        self.tares[usize::from(!is_tared)].fetch_add(1, Ordering::Relaxed);
    }

    /// Number of copies of the persistent state that the saving thread has not processed.
    pub fn copies_pending(&self) -> u64 {
        self.copies.load(Ordering::Acquire)
    }

    /// Counts a copy before it is passed to the saving thread.
    pub fn count_copy(&self) {
        self.copies.fetch_add(1, Ordering::AcqRel);
    }

    /// Counts a copy as processed, once what it contains is marked as unwritten.
    pub fn count_processed_copy(&self) {
        self.copies.fetch_sub(1, Ordering::AcqRel);
    }

    /// Number of input samples rejected by a full ring.
    pub fn input_dropped(&self) -> u64 {
        self.rejected.dropped.load(Ordering::Relaxed)
    }

    pub(super) fn count_dropped_input(&self) {
        self.rejected.dropped.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a suit sample that is withheld from the loop because its stamps are in the future.
    pub fn refuse_suit(&self, ahead_ns: u64) {
        self.refuse(&self.rejected.refused_suit, ahead_ns);
    }

    /// Counts such a ground sample.
    pub fn refuse_ground(&self, ahead_ns: u64) {
        self.refuse(&self.rejected.refused_ground, ahead_ns);
    }

    fn refuse(&self, stream: &AtomicU64, ahead_ns: u64) {
        stream.fetch_add(1, Ordering::Relaxed);
        self.rejected.ahead_ns.store(ahead_ns, Ordering::Relaxed);
    }

    /// Samples refused before the loop, since the start.
    pub fn refused(&self) -> Refused {
        Refused {
            suit: self.rejected.refused_suit.load(Ordering::Relaxed),
            ground: self.rejected.refused_ground.load(Ordering::Relaxed),
            ahead_ns: self.rejected.ahead_ns.load(Ordering::Relaxed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossbeam_channel::TryRecvError::{Disconnected, Empty};

    #[test]
    fn waiting_threads_are_woken_by_the_stop_and_by_the_end_of_the_loop() {
        let control = LoopControl::default();
        let running = control.mark_loop_running();
        assert_eq!((control.stopping().try_recv(), control.ended().try_recv()), (Err(Empty), Err(Empty)));
        control.stop();
        assert_eq!(
            (control.stopping().try_recv(), control.ended().try_recv()),
            (Err(Disconnected), Err(Empty))
        );
        assert!(!control.has_ended());
        drop(running);
        assert_eq!(control.ended().try_recv(), Err(Disconnected));
        assert!(control.has_ended());
    }

    #[test]
    fn a_loop_that_panicked_or_never_ran_has_ended_once_the_stop_is_requested() {
        let control = LoopControl::default();
        drop(control.mark_loop_running());
        assert_eq!(control.ended().try_recv(), Err(Empty));
        assert!(!control.has_ended());
        control.stop();
        assert_eq!(control.ended().try_recv(), Err(Disconnected));
    }
}
