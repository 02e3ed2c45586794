//! Single access point to the host's clocks.

use nix::time::{ClockId, clock_gettime};
use std::time::Duration;

/// CLOCK_MONOTONIC, ns.
pub fn now_monotonic_ns() -> u64 {
    read_ns(ClockId::CLOCK_MONOTONIC)
}

/// CLOCK_REALTIME, ns since 1970. Only for the translation of stamps; it may be stepped at any time.
pub(crate) fn now_realtime_ns() -> u64 {
    read_ns(ClockId::CLOCK_REALTIME)
}

fn read_ns(clock: ClockId) -> u64 {
    // Neither clock can fail on Linux; a zero would give an outdated sample, which is refused as stale.
    clock_gettime(clock).map(|time| Duration::from(time).as_nanos() as u64).unwrap_or(0)
}

/// Translates realtime stamps of the kernel to CLOCK_MONOTONIC.
#[derive(Debug, Default)]
pub(crate) struct StampTranslator {
    /// Realtime minus monotonic at the last reading.
    offset_ns: Option<i128>,
}

/// The two clocks diverge by at most 500 ppm (adjtimex); a larger change between two readings is a step.
const STEP_NS: i128 = 1_000_000;

impl StampTranslator {
    /// The monotonic time of a recent realtime stamp.
    pub(crate) fn monotonic_ns(&mut self, stamp_ns: u64) -> u64 {
        let realtime_ns = now_realtime_ns();
        self.translate(stamp_ns, realtime_ns, now_monotonic_ns())
    }

    /// Translates with one reading of both clocks. If realtime was stepped since the last reading, the stamp may
    /// precede the step and is invalid; the reading time then replaces it, which is later and therefore does not affect
    /// a clock fit.
    fn translate(&mut self, stamp_ns: u64, realtime_ns: u64, monotonic_ns: u64) -> u64 {
        let offset_ns = i128::from(realtime_ns) - i128::from(monotonic_ns);
        let before_ns = self.offset_ns.replace(offset_ns);
        if before_ns.is_none_or(|before_ns| (offset_ns - before_ns).abs() > STEP_NS) {
            return monotonic_ns;
        }
        monotonic_ns - realtime_ns.saturating_sub(stamp_ns).min(monotonic_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_of_the_wall_clock_does_not_move_stamps() {
        let mut translator = StampTranslator::default();
        assert_eq!(translator.translate(900, 1000, 50), 50, "no reading before: nothing to trust");
        assert_eq!(translator.translate(1900, 2000, 1050), 950);
        let stepped = 3_600_000_000_000;
        assert_eq!(translator.translate(2900, 3000 + stepped, 2050), 2050);
        assert_eq!(translator.translate(3900 + stepped, 4000 + stepped, 3050), 2950);
        assert_eq!(translator.translate(9900 + stepped, 4000 + stepped, 3050), 3050, "never in the future");
    }
}
