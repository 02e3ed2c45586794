//! Page faults of the loop after its warm-up.

/// Number of evaluations, one a second, without a new fault after which the incident ends.
const QUIET_AFTER_UPDATES: u32 = 10;

/// Monitors the count since the warm-up, once a second.
#[derive(Debug, Default)]
pub(super) struct PageFaults {
    last: u64,
    quiet_updates: Option<u32>,
}

impl PageFaults {
    /// Ingests the loop's minor and major faults since its warm-up, `None` before it is over; returns the number of new
    /// ones.
    pub(super) fn update(&mut self, since_warm_up: Option<[u64; 2]>) -> Option<u64> {
        let faults = since_warm_up?.iter().sum();
        let new = u64::saturating_sub(faults, std::mem::replace(&mut self.last, faults));
        if new > 0 {
            self.quiet_updates = Some(0);
            return Some(new);
        }
        self.quiet_updates =
            self.quiet_updates.map(|count| count + 1).filter(|count| *count < QUIET_AFTER_UPDATES);
        None
    }

    /// Whether there were new faults recently.
    pub(super) fn is_active(&self) -> bool {
        self.quiet_updates.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_count_once_and_end_after_quiet_updates() {
        let mut monitor = PageFaults::default();
        assert_eq!(monitor.update(None), None);
        assert_eq!(monitor.update(Some([0, 0])), None);
        assert!(!monitor.is_active());
        assert_eq!(monitor.update(Some([2, 1])), Some(3));
        for _ in 1..QUIET_AFTER_UPDATES {
            assert_eq!(monitor.update(Some([2, 1])), None);
            assert!(monitor.is_active());
        }
        assert_eq!(monitor.update(Some([2, 1])), None);
        assert!(!monitor.is_active());
    }
}
