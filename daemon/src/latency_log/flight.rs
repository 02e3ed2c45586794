//! The flight recorder: stores the last cycles and returns those around each missed deadline.

use std::collections::VecDeque;

use equipoise_core::time::NS_PER_S;

use crate::rings::Outcome;

/// Minimum pause after a record: a loop that misses every deadline must not fill the disk.
pub const PAUSE_NS: u64 = 10 * NS_PER_S;
/// Ratio of the cycles before a missed deadline to those after it.
const AFTER_DIVISOR: usize = 4;
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
    outcomes: VecDeque<Outcome>,
    open: Option<Open>,
    /// Due time of the last cycle of the last record.
    emitted_ns: Option<u64>,
    skipped: u64,
}

/// A window that is not yet complete.
#[derive(Debug, Clone, Copy)]
struct Open {
    cycle: u64,
    remaining: usize,
}

impl FlightRecorder {
    /// Stores `before` cycles before each missed deadline, and a quarter as many after it.
    pub fn new(before: usize) -> FlightRecorder {
        let after = (before / AFTER_DIVISOR).max(1);
        let cycles_max = WINDOWS_MAX * (before + 1 + after);
        let outcomes = VecDeque::with_capacity(cycles_max + 1);
        FlightRecorder { before, after, cycles_max, outcomes, open: None, emitted_ns: None, skipped: 0 }
    }

    /// Ingests one cycle; returns the window that it completes, if any.
    pub fn record(&mut self, outcome: &Outcome) -> Option<Flight> {
        let record = &outcome.record;
        let missed = record.deadline_missed != 0;
        let opens = missed && self.is_pause_over(record.due_ns);
        self.outcomes.push_back(*outcome);
        match &mut self.open {
            Some(open) => open.remaining = if missed { self.after } else { open.remaining - 1 },
            None if opens => {
                self.open = Some(Open { cycle: record.cycle, remaining: self.after });
            }
            None => {
                self.skipped += u64::from(missed);
                self.trim();
            }
        }
        let full = self.outcomes.len() >= self.cycles_max;
        let ready = self.open.is_some_and(|open| open.remaining == 0 || full);
        if ready { self.emit(record.due_ns) } else { None }
    }

    /// Returns the incomplete window at the end.
    pub fn end(&mut self) -> Option<Flight> {
        let newest_ns = self.outcomes.back()?.record.due_ns;
        self.emit(newest_ns)
    }

    /// Number of missed deadlines without a record since the last call.
    pub fn take_skipped(&mut self) -> u64 {
        std::mem::take(&mut self.skipped)
    }

    fn is_pause_over(&self, now_ns: u64) -> bool {
        self.emitted_ns.is_none_or(|emitted_ns| now_ns >= emitted_ns.saturating_add(PAUSE_NS))
    }

    fn emit(&mut self, now_ns: u64) -> Option<Flight> {
        let open = self.open.take()?;
        self.emitted_ns = Some(now_ns);
        let flight = Flight { cycle: open.cycle, outcomes: self.outcomes.iter().copied().collect() };
        self.trim();
        Some(flight)
    }

    fn trim(&mut self) {
        while self.outcomes.len() > self.before {
            self.outcomes.pop_front();
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

    fn record_all(missed: &[u64], cycles: u64, period_ns: u64) -> (Vec<(u64, Vec<u64>)>, u64) {
        let mut recorder = FlightRecorder::new(BEFORE);
        let mut flights = Vec::new();
        for cycle in 1..=cycles {
            let deadline_missed = u32::from(missed.contains(&cycle));
            let due_ns = cycle * period_ns;
            let record = CycleRecord { cycle, due_ns, deadline_missed, ..CycleRecord::zeroed() };
            flights.extend(recorder.record(&Outcome { state: State::zeroed(), record }));
            assert!(recorder.outcomes.len() <= recorder.cycles_max);
        }
        flights.extend(recorder.end());
        let cycles_of =
            |flight: &Flight| flight.outcomes.iter().map(|outcome| outcome.record.cycle).collect();
        let recorded = flights.iter().map(|flight| (flight.cycle, cycles_of(flight))).collect();
        (recorded, recorder.take_skipped())
    }

    #[test]
    fn the_cycles_around_a_missed_deadline_are_emitted() {
        let (flights, skipped) = record_all(&[20], 40, 1_000_000);
        assert_eq!(flights, [(20, (12..=22).collect())]);
        assert_eq!(skipped, 0);
    }

    #[test]
    fn a_window_at_the_start_or_end_is_shorter() {
        assert_eq!(record_all(&[1], 40, 1_000_000).0, [(1, (1..=3).collect())]);
        assert_eq!(record_all(&[40], 40, 1_000_000).0, [(40, (32..=40).collect())]);
        assert!(record_all(&[], 40, 1_000_000).0.is_empty());
    }

    #[test]
    fn windows_that_overlap_merge() {
        let (flights, skipped) = record_all(&[20, 21, 23], 40, 1_000_000);
        assert_eq!(flights, [(20, (12..=25).collect())]);
        assert_eq!(skipped, 0);
    }

    #[test]
    fn one_flight_in_ten_seconds_is_emitted_and_the_others_are_counted() {
        // Ten cycles a second: the pause is 100 cycles, counted from the last cycle of the previous record.
        let (flights, skipped) = record_all(&[20, 30, 60, 121, 122, 240], 300, NS_PER_S / 10);
        let starts: Vec<u64> = flights.iter().map(|(cycle, _)| *cycle).collect();
        assert_eq!(starts, [20, 122, 240]);
        assert_eq!(skipped, 3);
        assert_eq!(flights[1].1, (114..=124).collect::<Vec<_>>());
    }

    #[test]
    fn a_loop_that_misses_everything_fills_neither_memory_nor_disk() {
        let all: Vec<u64> = (1..=5000).collect();
        let (flights, skipped) = record_all(&all, 5000, 1_000_000);
        assert_eq!(flights.len(), 1);
        assert_eq!(flights[0].1.len(), WINDOWS_MAX * (BEFORE + 1 + AFTER));
        assert_eq!(flights[0].1.len() as u64 + skipped, 5000);
    }
}
