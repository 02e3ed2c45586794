//! Statistics of the loop's run: late cycles, and whether every slot is accounted for.

use std::fmt;

use crate::schedule::Schedule;

/// A cycle whose state was ready only after the next was due.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Miss {
    /// Number of the cycle, as in `CycleRecord::cycle`.
    pub cycle: u64,
    /// By how much its deadline was missed, ns.
    pub late_ns: u64,
}

impl fmt::Display for Miss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cycle {}, {:.3} ms late", self.cycle, self.late_ns as f64 * 1e-6)
    }
}

/// Summary of all misses of a loop in constant memory. Each single miss is in its cycle record.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Misses {
    /// Number of misses.
    pub count: u64,
    /// The last miss.
    pub last: Option<Miss>,
    /// The miss with the largest lateness; of equal ones the first.
    pub worst: Option<Miss>,
}

impl Misses {
    /// Ingests the time at which a cycle was ready; returns whether it missed its deadline.
    pub fn check(&mut self, cycle: u64, ready_ns: u64, deadline_ns: u64) -> bool {
        let late_ns = ready_ns.saturating_sub(deadline_ns);
        if late_ns == 0 {
            return false;
        }
        let miss = Miss { cycle, late_ns };
        self.count += 1;
        self.last = Some(miss);
        if self.worst.is_none_or(|worst| late_ns > worst.late_ns) {
            self.worst = Some(miss);
        }
        true
    }
}

/// Statistics of the loop's run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LoopSummary {
    /// Number of cycles started.
    pub cycles: u64,
    /// Slots of the schedule without a cycle.
    pub slots_skipped: u64,
    /// Cycles whose state was ready only after the next cycle was due.
    pub deadlines_missed: u64,
    /// The last and the worst miss.
    pub misses: Misses,
    /// From the first cycle's due time to the end of the last cycle, by the clock, ns.
    pub elapsed_ns: u64,
    /// Length of a slot, ns.
    pub period_ns: u64,
    /// Whether `elapsed / period == cycles + slots_skipped`, by the schedule and by the clock.
    pub adds_up: bool,
}

impl LoopSummary {
    /// For a loop whose last cycle ended at `ended_ns`; the schedule has advanced to a slot that was not started.
    pub(super) fn of(cycles: u64, misses: Misses, schedule: &Schedule, ended_ns: u64) -> LoopSummary {
        let (elapsed_ns, period_ns) = (ended_ns.saturating_sub(schedule.start_ns()), schedule.period_ns());
        let slots = cycles + schedule.slots_skipped();
        // The last cycle ended in its own slot or, if it was late, in the following one.
        let passed = elapsed_ns / period_ns;
        let by_the_clock = passed == slots || passed + 1 == slots;
        LoopSummary {
            cycles,
            slots_skipped: schedule.slots_skipped(),
            deadlines_missed: misses.count,
            misses,
            elapsed_ns,
            period_ns,
            adds_up: cycles == 0 || (schedule.adds_up(cycles + 1) && by_the_clock),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_and_the_latest_miss_are_stored_with_their_cycles() {
        let mut misses = Misses::default();
        let late_ns = [0, 30, 0, 90, 90, 10, 0];
        let missed: Vec<bool> =
            (1..).zip(late_ns).map(|(cycle, late_ns)| misses.check(cycle, 1_000 + late_ns, 1_000)).collect();
        assert_eq!(missed, late_ns.map(|late_ns| late_ns > 0));
        assert_eq!(misses.count, 4);
        assert_eq!(misses.last, Some(Miss { cycle: 6, late_ns: 10 }));
        assert_eq!(misses.worst, Some(Miss { cycle: 4, late_ns: 90 }));
    }

    #[test]
    fn unobserved_slots_fail_the_schedule_check() {
        let schedule = |ends_ns: &[u64]| {
            let mut schedule = Schedule::new(1_000, 100);
            ends_ns.iter().for_each(|now_ns| schedule.advance(*now_ns));
            schedule
        };
        let of = |cycles, ends_ns: &[u64], now_ns| {
            LoopSummary::of(cycles, Misses::default(), &schedule(ends_ns), now_ns)
        };
        assert!(of(3, &[1_020, 1_120, 1_220], 1_230).adds_up);
        let late = of(2, &[1_020, 1_550], 1_560);
        assert!(late.adds_up, "{late:?}");
        assert_eq!(
            (late.slots_skipped, late.elapsed_ns / late.period_ns),
            (3, late.cycles + late.slots_skipped)
        );
        assert!(!of(2, &[1_020, 1_120, 1_220], 1_230).adds_up, "a cycle was not counted");
        assert!(!of(3, &[1_020, 1_120, 1_220], 1_030).adds_up, "the schedule ran ahead of the clock");
        assert!(of(0, &[], 900).adds_up, "nothing was begun");
    }
}
