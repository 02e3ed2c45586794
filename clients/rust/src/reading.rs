//! Result of reading: a current state, or the reason why there is none.

use equipoise_bus::BusError;
use equipoise_core::message::{State, Validity};
use std::time::Duration;

/// A current state with its ages and counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// The state. Check [`Reading::validity`] before using its values.
    pub state: State,
    /// Time of receipt, CLOCK_MONOTONIC ns.
    pub received_ns: u64,
    /// Time from the due time of its cycle to its return, ns.
    pub age_ns: u64,
    /// Age of the sample time to which torques, forces and centres refer, when the state was returned, ns; `None`
    /// before the first. Tens of milliseconds more than `age_ns` (`State::group_delay_ns`).
    pub sample_age_ns: Option<u64>,
    /// States that were not returned since the last new one: overwritten before they were read, or too old.
    pub missed: u64,
    /// The daemon restarted between the last new state and this one; `missed` then counts states of the new daemon
    /// only.
    pub restarted: bool,
    /// Number of the daemon's start that published the state, counted by this consumer from 1; it increments with each
    /// restart. Unlike `restarted` it is set in every reading.
    pub daemon_life: u32,
    /// Whether it was not returned before; only [`crate::Consumer::latest`] returns a state again.
    pub is_new: bool,
}

impl Reading {
    /// The validity flags of the state.
    pub fn validity(&self) -> Validity {
        self.state.validity()
    }

    pub(crate) fn at(mut self, now_ns: u64) -> Reading {
        self.age_ns = now_ns.saturating_sub(self.state.time_ns);
        let sample_ns = self.state.suit_sample_time_ns;
        self.sample_age_ns = (sample_ns > 0).then(|| now_ns.saturating_sub(sample_ns));
        self
    }
}

/// Reason why there is no current state.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoReading {
    /// No new state arrived: the daemon is not running, or hangs.
    #[error("silent: no state for {} ms; is the daemon running?", silent.as_millis())]
    Silent {
        /// Time since the last state was received, or since joining.
        silent: Duration,
    },
    /// States arrived, but all too late; this is the age of the newest.
    #[error("stale: the newest state is {} ms old, and may be {} ms; is this consumer or the daemon starved of CPU?",
        age.as_millis(), stale_after.as_millis())]
    Stale {
        /// Time since its cycle was due.
        age: Duration,
        /// Maximum age of the settings.
        stale_after: Duration,
    },
    /// States have times in the future: the daemon has another CLOCK_MONOTONIC, so ages are meaningless.
    #[error("the daemon's clock is {} ms ahead of this one's; run both in one time namespace", ahead.as_millis())]
    OtherClock {
        /// By how much.
        ahead: Duration,
    },
    /// The bus cannot be read; the consumer rejoins by itself, and returns this until then.
    #[error(transparent)]
    Bus(#[from] BusError),
}
