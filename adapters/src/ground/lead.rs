//! Lead of a device's clock over the host's: it reveals a restart that looks like a leap ahead because the device's
//! count wraps.

/// No reading arrives earlier than all others, relative to its device time, by more than this: latency never varies as
/// much.
const SLACK_NS: i64 = 1_000_000_000;

/// A clock whose readings arrive in order. Delayed readings lag; none can be ahead of the fastest.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lead {
    last_arrival_ns: u64,
    /// Lead of the last reading relative to the first.
    ahead_ns: i64,
    most_ns: i64,
}

impl Lead {
    /// Starts with the first reading.
    pub(super) fn begin(&mut self, arrival_ns: u64) {
        *self = Lead { last_arrival_ns: arrival_ns, ahead_ns: 0, most_ns: 0 };
    }

    /// Processes a forward step of the device's clock; returns whether the host's elapsed time can contain it.
    pub(super) fn allows(&mut self, step_ns: u64, arrival_ns: u64) -> bool {
        let signed = |ns: u64| i64::try_from(ns).unwrap_or(i64::MAX);
        let since_ns = signed(arrival_ns.saturating_sub(self.last_arrival_ns));
        self.last_arrival_ns = arrival_ns;
        self.ahead_ns = self.ahead_ns.saturating_add(signed(step_ns)).saturating_sub(since_ns);
        let credible = self.ahead_ns <= self.most_ns.saturating_add(SLACK_NS);
        self.most_ns = self.most_ns.max(self.ahead_ns);
        credible
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NS_PER_MS: u64 = 1_000_000;

    #[test]
    fn a_burst_after_a_pause_with_a_hole_in_it_is_no_restart_and_a_leap_is() {
        let mut lead = Lead::default();
        lead.begin(0);
        for index in 1..100 {
            assert!(lead.allows(10 * NS_PER_MS, index * 10 * NS_PER_MS));
        }
        // No read for 20 s; the line buffered the first second of readings, and the newest.
        for _ in 0..100 {
            assert!(lead.allows(10 * NS_PER_MS, 21_000 * NS_PER_MS));
        }
        assert!(lead.allows(19_000 * NS_PER_MS, 21_000 * NS_PER_MS));
        assert!(!lead.allows(1_300_000 * NS_PER_MS, 21_010 * NS_PER_MS));
    }

    #[test]
    fn a_clock_that_runs_at_another_pace_is_borne() {
        let mut lead = Lead::default();
        lead.begin(0);
        assert!((1..10_000).all(|index| lead.allows(100 * NS_PER_MS, index * 10 * NS_PER_MS)));
    }
}
