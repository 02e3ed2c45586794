//! What a consumer is handed: a state that is current, or the reason why there is none.

use equipoise_bus::BusError;
use equipoise_core::message::{State, Validity};
use std::time::Duration;

/// A state that is current, with what a controller must know about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// The state. Look at [`Reading::validity`] before using a value of it.
    pub state: State,
    /// When it was picked up, CLOCK_MONOTONIC.
    pub picked_up_ns: u64,
    /// How long ago its cycle was due, when it was handed out.
    pub age_ns: u64,
    /// How old the moment is that torques, forces and centres are about, when it was handed out; `None` before the
    /// first. Tens of milliseconds more than `age_ns` (`State::group_delay_ns`).
    pub moment_age_ns: Option<u64>,
    /// States since the last new one that were not handed out: overwritten before they were read, or too old.
    pub missed: u64,
    /// The daemon was started anew between the last new state and this one; `missed` then counts the new one's only.
    pub restarted: bool,
    /// Number of the daemon's life that the state is from, as this consumer counts them: 1 is the first it heard, and a
    /// larger one than before a daemon started anew. Unlike `restarted` it is told with every state.
    pub daemon_life: u32,
    /// Whether it was not handed out before; only [`crate::Consumer::latest`] hands one out again.
    pub is_new: bool,
}

impl Reading {
    /// The reasons why values of the state must not be used.
    pub fn validity(&self) -> Validity {
        self.state.validity()
    }

    pub(crate) fn at(mut self, now_ns: u64) -> Reading {
        self.age_ns = now_ns.saturating_sub(self.state.time_ns);
        let moment_ns = self.state.suit_sample_time_ns;
        self.moment_age_ns = (moment_ns > 0).then(|| now_ns.saturating_sub(moment_ns));
        self
    }
}

/// Why there is no current state.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoReading {
    /// No new state came: the daemon is not running, or hangs.
    #[error("silent: no state for {} ms; is the daemon running?", silent.as_millis())]
    Silent {
        /// Since the last state was picked up, or since joining.
        silent: Duration,
    },
    /// States came, but all too late: the newest of them is this old.
    #[error("stale: the newest state is {} ms old, and may be {} ms; is this consumer or the daemon starved of CPU?",
        age.as_millis(), stale_after.as_millis())]
    Stale {
        /// Since its cycle was due.
        age: Duration,
        /// How old it may be.
        stale_after: Duration,
    },
    /// States come from the future: the daemon has another CLOCK_MONOTONIC, so ages mean nothing.
    #[error("the daemon's clock is {} ms ahead of this one's; run both in one time namespace", ahead.as_millis())]
    OtherClock {
        /// How far.
        ahead: Duration,
    },
    /// The bus cannot be read; the consumer joins anew by itself.
    #[error(transparent)]
    Bus(#[from] BusError),
}
