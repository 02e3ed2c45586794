//! The flight recorder: stores the last cycles and returns those around each missed deadline.

use std::collections::VecDeque;

use equipoise_core::time::NS_PER_S;

use crate::rings::Outcome;

/// Minimum pause after a record: a loop that misses every deadline must not fill the disk.
pub const PAUSE_NS: u64 = 10 * NS_PER_S;
/// Ratio of the cycles before a missed deadline to those after it.
const AFTER_SHARE: usize = 4;
/// Merged windows are cut at this many window lengths.
const WINDOWS_MAX: usize = 4;

/// The cycles around one missed deadline, or around several whose windows overlap.
#[derive(Debug, Clone)]
pub struct Flight {
    /// The first cycle of the record that missed its deadline.
    pub cycle: u64,
    /// The received cycles, oldest first.
    pub outcomes: Vec<Outcome>,
}

/// Receives every cycle. Allocates at the start and for each returned record only.
#[derive(Debug)]
pub struct FlightRecorder {
    before: usize,
    after: usize,
    cycles_max: usize,
    kept: VecDeque<Outcome>,
    open: Option<Open>,
    /// Due time of the last cycle of the last record.
    given_ns: Option<u64>,
    left_out: u64,
}

/// A window that is not yet complete.
#[derive(Debug, Clone, Copy)]
struct Open {
    cycle: u64,
    to_come: usize,
}

impl FlightRecorder {
    /// Stores `before` cycles before each missed deadline, and a quarter as many after it.
    pub fn new(before: usize) -> FlightRecorder {
        let after = (before / AFTER_SHARE).max(1);
        let cycles_max = WINDOWS_MAX * (before + 1 + after);
        let kept = VecDeque::with_capacity(cycles_max + 1);
        FlightRecorder { before, after, cycles_max, kept, open: None, given_ns: None, left_out: 0 }
    }

    /// Ingests one cycle; returns the window that it completes, if any.
    pub fn enter(&mut self, outcome: &Outcome) -> Option<Flight> {
        let record = &outcome.record;
        let missed = record.deadline_missed != 0;
        let begins = missed && self.has_paused(record.due_ns);
        self.kept.push_back(*outcome);
        match &mut self.open {
            Some(open) => open.to_come = if missed { self.after } else { open.to_come - 1 },
            None if begins => {
                self.open = Some(Open { cycle: record.cycle, to_come: self.after });
            }
            None => {
                self.left_out += u64::from(missed);
                self.forget();
            }
        }
        let full = self.kept.len() >= self.cycles_max;
        let ready = self.open.is_some_and(|open| open.to_come == 0 || full);
        if ready { self.give_out(record.due_ns) } else { None }
    }

    /// Returns the incomplete window at the end.
    pub fn end(&mut self) -> Option<Flight> {
        let newest_ns = self.kept.back()?.record.due_ns;
        self.give_out(newest_ns)
    }

    /// Number of missed deadlines without a record since the last call.
    pub fn take_left_out(&mut self) -> u64 {
        std::mem::take(&mut self.left_out)
    }

    fn has_paused(&self, now_ns: u64) -> bool {
        self.given_ns.is_none_or(|given_ns| now_ns >= given_ns.saturating_add(PAUSE_NS))
    }

    fn give_out(&mut self, now_ns: u64) -> Option<Flight> {
        let open = self.open.take()?;
        self.given_ns = Some(now_ns);
        let flight = Flight { cycle: open.cycle, outcomes: self.kept.iter().copied().collect() };
        self.forget();
        Some(flight)
    }

    fn forget(&mut self) {
        while self.kept.len() > self.before {
            self.kept.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::{CycleRecord, State};

    const BEFORE: usize = 8;
    const AFTER: usize = 2;

    fn fly(missed: &[u64], cycles: u64, period_ns: u64) -> (Vec<(u64, Vec<u64>)>, u64) {
        let mut recorder = FlightRecorder::new(BEFORE);
        let mut flights = Vec::new();
        for cycle in 1..=cycles {
            let deadline_missed = u32::from(missed.contains(&cycle));
            let due_ns = cycle * period_ns;
            let record = CycleRecord { cycle, due_ns, deadline_missed, ..CycleRecord::zeroed() };
            flights.extend(recorder.enter(&Outcome { state: State::zeroed(), record }));
            assert!(recorder.kept.len() <= recorder.cycles_max);
        }
        flights.extend(recorder.end());
        let cycles_of =
            |flight: &Flight| flight.outcomes.iter().map(|outcome| outcome.record.cycle).collect();
        let recorded = flights.iter().map(|flight| (flight.cycle, cycles_of(flight))).collect();
        (recorded, recorder.take_left_out())
    }

    #[test]
    fn the_cycles_around_a_missed_deadline_are_given_out() {
        let (flights, left_out) = fly(&[20], 40, 1_000_000);
        assert_eq!(flights, [(20, (12..=22).collect())]);
        assert_eq!(left_out, 0);
    }

    #[test]
    fn at_the_beginning_and_the_end_there_is_less_around_it() {
        assert_eq!(fly(&[1], 40, 1_000_000).0, [(1, (1..=3).collect())]);
        assert_eq!(fly(&[40], 40, 1_000_000).0, [(40, (32..=40).collect())]);
        assert!(fly(&[], 40, 1_000_000).0.is_empty());
    }

    #[test]
    fn windows_that_overlap_merge() {
        let (flights, left_out) = fly(&[20, 21, 23], 40, 1_000_000);
        assert_eq!(flights, [(20, (12..=25).collect())]);
        assert_eq!(left_out, 0);
    }

    #[test]
    fn one_in_ten_seconds_is_given_out_and_the_others_are_counted() {
        // Ten cycles a second: the pause is 100 cycles, counted from the last cycle of the previous record.
        let (flights, left_out) = fly(&[20, 30, 60, 121, 122, 240], 300, NS_PER_S / 10);
        let begun: Vec<u64> = flights.iter().map(|(cycle, _)| *cycle).collect();
        assert_eq!(begun, [20, 122, 240]);
        assert_eq!(left_out, 3);
        assert_eq!(flights[1].1, (114..=124).collect::<Vec<_>>());
    }

    #[test]
    fn a_loop_that_misses_everything_fills_neither_memory_nor_disk() {
        let all: Vec<u64> = (1..=5000).collect();
        let (flights, left_out) = fly(&all, 5000, 1_000_000);
        assert_eq!(flights.len(), 1);
        assert_eq!(flights[0].1.len(), WINDOWS_MAX * (BEFORE + 1 + AFTER));
        assert_eq!(flights[0].1.len() as u64 + left_out, 5000);
    }
}
