//! The newest early state, as returned to a caller.

use crate::reading::NoReading;
use equipoise_bus::Topic;
use equipoise_core::message::{EarlyState, Validity};
use std::time::Duration;

/// Maximum time since the cycle of a returned early state: the deadline of its service.
pub(crate) const STALE_AFTER: Duration = match EarlyState::SERVICE.deadline {
    Some(deadline) => deadline,
    None => Duration::MAX,
};

/// A current early state with its ages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EarlyReading {
    /// The early state. Check [`EarlyReading::validity`] before using its values.
    pub early: EarlyState,
    /// Time of receipt, CLOCK_MONOTONIC ns.
    pub received_ns: u64,
    /// Time from the due time of its cycle to its return, ns.
    pub age_ns: u64,
    /// Age of the sample that the results refer to, when it was returned, ns.
    pub sample_age_ns: u64,
    /// Whether it was not returned before.
    pub is_new: bool,
}

impl EarlyReading {
    /// A reading at `now_ns`, unless it is too old or of another clock.
    pub(crate) fn at(
        early: EarlyState,
        received_ns: u64,
        is_new: bool,
        now_ns: u64,
    ) -> Result<EarlyReading, NoReading> {
        if early.time_ns > now_ns {
            return Err(NoReading::OtherClock { ahead: Duration::from_nanos(early.time_ns - now_ns) });
        }
        let age_ns = now_ns - early.time_ns;
        let age = Duration::from_nanos(age_ns);
        if age > STALE_AFTER {
            return Err(NoReading::Stale { age, stale_after: STALE_AFTER });
        }
        let sample_age_ns = now_ns.saturating_sub(early.sample_time_ns);
        Ok(EarlyReading { early, received_ns, age_ns, sample_age_ns, is_new })
    }

    /// The validity flags of the early state.
    pub fn validity(&self) -> Validity {
        self.early.validity()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn an_old_early_state_and_one_of_another_clock_are_not_returned() {
        let early =
            EarlyState { time_ns: 1_000_000_000, sample_time_ns: 999_000_000, ..EarlyState::zeroed() };
        let at = |now_ns| EarlyReading::at(early, now_ns, true, now_ns);
        let current = at(1_002_000_000).ok();
        assert_eq!(
            current.map(|reading| (reading.age_ns, reading.sample_age_ns)),
            Some((2_000_000, 3_000_000))
        );
        assert!(matches!(at(1_041_000_000), Err(NoReading::Stale { .. })));
        assert!(matches!(at(999_000_000), Err(NoReading::OtherClock { .. })));
    }
}
