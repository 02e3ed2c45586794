//! The loop's clock.

use crate::realtime;

/// Clock that the loop reads and sleeps on.
pub trait Clock {
    /// The current time, ns.
    fn now_ns(&mut self) -> u64;
    /// Returns at an absolute time or later.
    fn sleep_until(&mut self, due_ns: u64);
}

/// CLOCK_MONOTONIC, the clock of the daemon. In tests another clock runs the same loop faster than real time.
#[derive(Debug, Clone, Copy)]
pub struct Monotonic;

impl Clock for Monotonic {
    fn now_ns(&mut self) -> u64 {
        realtime::now_ns()
    }

    fn sleep_until(&mut self, due_ns: u64) {
        realtime::sleep_until(due_ns);
    }
}
