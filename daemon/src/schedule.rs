//! The absolute schedule: slot k is due at `start + k · period`, independent of previous cycles.
//!
//! A late cycle never shifts the phase. If whole periods have passed, their slots are skipped and counted, so that at
//! any cycle `(due − start) / period == cycles + slots_skipped − 1`.

/// Due times of the cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schedule {
    start_ns: u64,
    period_ns: u64,
    slot: u64,
    slots_skipped: u64,
}

impl Schedule {
    /// The first slot is due at `start_ns`. The period must not be zero.
    pub fn new(start_ns: u64, period_ns: u64) -> Schedule {
        Schedule { start_ns, period_ns: period_ns.max(1), slot: 0, slots_skipped: 0 }
    }

    /// Due time of the first slot.
    pub fn start_ns(&self) -> u64 {
        self.start_ns
    }

    /// Due time of the current slot, CLOCK_MONOTONIC.
    pub fn due_ns(&self) -> u64 {
        self.start_ns + self.slot * self.period_ns
    }

    /// Due time of the next slot: the deadline of the current cycle.
    pub fn deadline_ns(&self) -> u64 {
        self.due_ns() + self.period_ns
    }

    /// Advances to the next slot that has not passed completely at `now_ns`.
    pub fn advance(&mut self, now_ns: u64) {
        let next = self.slot + 1;
        let current = now_ns.saturating_sub(self.start_ns) / self.period_ns;
        self.slot = next.max(current);
        self.slots_skipped += self.slot - next;
    }

    /// Slots skipped since the start.
    pub fn slots_skipped(&self) -> u64 {
        self.slots_skipped
    }

    /// Length of a slot.
    pub fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// Whether `elapsed / period == slots + slots_skipped` after `cycles` cycles have started.
    pub fn adds_up(&self, cycles: u64) -> bool {
        (self.due_ns() - self.start_ns) / self.period_ns + 1 == cycles + self.slots_skipped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_time_nothing_is_skipped() {
        let mut schedule = Schedule::new(1000, 100);
        for cycle in 1..=50 {
            assert_eq!(schedule.due_ns(), 1000 + (cycle - 1) * 100);
            assert!(schedule.adds_up(cycle));
            schedule.advance(schedule.due_ns() + 60);
        }
        assert_eq!(schedule.slots_skipped(), 0);
    }

    #[test]
    fn a_late_cycle_skips_whole_slots_and_keeps_the_phase() {
        let mut schedule = Schedule::new(1000, 100);
        schedule.advance(1000 + 350);
        // Slots 1 and 2 have passed; slot 3 is due at 1300 and starts 50 late.
        assert_eq!((schedule.due_ns(), schedule.slots_skipped()), (1300, 2));
        assert!(schedule.adds_up(2));
        schedule.advance(1360);
        assert_eq!((schedule.due_ns(), schedule.slots_skipped()), (1400, 2));
    }

    #[test]
    fn the_identity_holds_for_any_lateness() {
        let (mut schedule, mut noise) = (Schedule::new(77, 1_000_000), 12345_u64);
        for cycle in 1..10_000 {
            assert!(schedule.adds_up(cycle));
            noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            schedule.advance(schedule.due_ns() + (noise >> 33) % 5_000_000);
        }
    }
}
