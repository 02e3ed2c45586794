//! Wakes egress: at most one system call of the loop for each outcome, and none while egress is awake.

use std::os::fd::{AsFd, OwnedFd};
use std::sync::atomic::{AtomicBool, Ordering, fence};
use std::time::Duration;

use crossbeam_utils::CachePadded;
use rustix::event::{EventfdFlags, PollFd, PollFlags, eventfd, poll};

/// Shared by the loop, which wakes, and egress, which sleeps.
#[derive(Debug)]
pub(super) struct WakeUp {
    outcome_ready: OwnedFd,
    /// Set while egress sleeps or is about to: the thread that clears it must wake egress. In a cache line of its own,
    /// because both threads write it in every cycle.
    sleeping: CachePadded<AtomicBool>,
}

impl WakeUp {
    /// # Errors
    /// The kernel provides no event file descriptor.
    pub(super) fn new() -> std::io::Result<WakeUp> {
        let outcome_ready = eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?;
        Ok(WakeUp { outcome_ready, sleeping: CachePadded::default() })
    }

    /// Wakes egress if it sleeps. For the loop, after it has pushed an outcome.
    pub(super) fn wake(&self) {
        // Pairs with the fence in [`Self::sleep`]: either this thread reads that egress sleeps, or egress reads the
        // outcome.
        fence(Ordering::SeqCst);
        if self.sleeping.swap(false, Ordering::Relaxed) {
            // Writing fails only if the counter is full; egress is woken in that case too.
            let _ = rustix::io::write(&self.outcome_ready, &1_u64.to_ne_bytes());
        }
    }

    /// Sleeps until woken or until the timeout, unless an outcome is available. For egress.
    pub(super) fn sleep(&self, has_outcome: impl FnOnce() -> bool, timeout: Duration) {
        self.sleeping.store(true, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        if !has_outcome() && self.wait(timeout) {
            let _ = rustix::io::read(&self.outcome_ready, &mut [0_u8; 8]);
        }
        self.sleeping.store(false, Ordering::Relaxed);
    }

    /// Waits for a wake-up, which remains pending; returns whether it arrived before the timeout.
    pub(super) fn wait(&self, timeout: Duration) -> bool {
        let timeout = rustix::time::Timespec {
            tv_sec: timeout.as_secs() as i64,
            tv_nsec: i64::from(timeout.subsec_nanos()),
        };
        let mut descriptors = [PollFd::from_borrowed_fd(self.outcome_ready.as_fd(), PollFlags::IN)];
        poll(&mut descriptors, Some(&timeout)).is_ok_and(|ready| ready > 0)
    }
}
