//! Page faults of the loop after its warm-up.

/// Number of evaluations, one a second, without a new fault after which the incident ends.
const RESTS_AFTER_LOOKS: u32 = 10;

/// Monitors the count since the warm-up, once a second.
#[derive(Debug, Default)]
pub(super) struct PageFaults {
    last: u64,
    quiet_looks: Option<u32>,
}

impl PageFaults {
    /// Ingests the loop's minor and major faults since its warm-up, `None` before it is over; returns the number of new
    /// ones.
    pub(super) fn look(&mut self, since_warm_up: Option<[u64; 2]>) -> Option<u64> {
        let faults = since_warm_up?.iter().sum();
        let new = u64::saturating_sub(faults, std::mem::replace(&mut self.last, faults));
        if new > 0 {
            self.quiet_looks = Some(0);
            return Some(new);
        }
        self.quiet_looks = self.quiet_looks.map(|looks| looks + 1).filter(|looks| *looks < RESTS_AFTER_LOOKS);
        None
    }

    /// Whether there were new faults recently.
    pub(super) fn goes_on(&self) -> bool {
        self.quiet_looks.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_count_once_and_rest_ends_them() {
        let mut watch = PageFaults::default();
        assert_eq!(watch.look(None), None);
        assert_eq!(watch.look(Some([0, 0])), None);
        assert!(!watch.goes_on());
        assert_eq!(watch.look(Some([2, 1])), Some(3));
        for _ in 1..RESTS_AFTER_LOOKS {
            assert_eq!(watch.look(Some([2, 1])), None);
            assert!(watch.goes_on());
        }
        assert_eq!(watch.look(Some([2, 1])), None);
        assert!(!watch.goes_on());
    }
}
