//! A counter that should not grow: an incident from its first increase until it has been constant for a while.

use equipoise_core::time::NS_PER_S;

/// Time without an increase after which the incident ends: long enough that a fault repeated every second is one
/// incident in the journal.
const QUIET_AFTER_NS: u64 = 10_000_000_000;

/// Monitors one counter.
#[derive(Debug, Default)]
pub(super) struct Growth {
    count: u64,
    active: bool,
    quiet_ns: u64,
}

impl Growth {
    /// Ingests the count, `gap_ns` after the last call; returns whether it grew recently.
    pub(super) fn update(&mut self, count: u64, gap_ns: u64) -> bool {
        if count > self.count {
            (self.active, self.quiet_ns) = (true, 0);
        } else {
            self.quiet_ns += gap_ns;
            self.active &= self.quiet_ns < QUIET_AFTER_NS;
        }
        self.count = count;
        self.active
    }

    /// Time of the last increase, for a message.
    pub(super) fn last(&self) -> String {
        match self.quiet_ns / NS_PER_S {
            0 => "the last just now".to_owned(),
            seconds => format!("the last {seconds} s ago"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn active_from_the_first_growth_until_ten_quiet_seconds() {
        let mut growth = Growth::default();
        assert!(!growth.update(0, 1_000_000_000));
        for second in 0..50 {
            // Every five seconds: one incident, not ten.
            assert!(growth.update(1 + second / 5, 1_000_000_000), "second {second}");
        }
        let ended = (0..20).take_while(|_| growth.update(10, 1_000_000_000)).count();
        assert!((5..10).contains(&ended), "{ended}");
        assert!(growth.update(11, 1), "a new growth is reported");
        assert_eq!(growth.last(), "the last just now");
        growth.update(11, 3_500_000_000);
        assert_eq!(growth.last(), "the last 3 s ago");
    }
}
