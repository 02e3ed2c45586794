//! Detects clock faults: the computer was suspended, its clock source changed, samples have stamps of another clock, or
//! a device's counter is not synchronised with the host's time.

use equipoise_core::message::CycleRecord;
use equipoise_core::time::seconds;
use rustix::time::{ClockId, clock_gettime};

/// CLOCK_BOOTTIME continues while the computer is suspended, CLOCK_MONOTONIC does not. Two successive readings differ
/// by microseconds or a lost time slice; a larger difference than this means a suspension.
const SUSPENDED_MIN_NS: u64 = 200_000_000;
/// A clock fit is available after eight samples; a longer time without one, while samples arrive, is a fault.
const UNSYNCHRONISED_AFTER_NS: u64 = 10_000_000_000;
/// A sample cannot arrive after the cycle that ingested it, except for the offset between two cores' counters, which is
/// below this.
const AHEAD_NS: u64 = 10_000_000;
/// Rings and sockets hold less than this of any stream, so an older sample was stamped by another clock …
const OLD_NS: u64 = 5_000_000_000;
/// … unless this process was stopped; then the stamps become plausible again within this time.
const STAMP_FAULT_AFTER_NS: u64 = 2_000_000_000;

/// The host's clocks at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct HostClock {
    /// CLOCK_MONOTONIC.
    pub(super) monotonic_ns: u64,
    /// CLOCK_BOOTTIME.
    pub(super) boottime_ns: u64,
}

impl HostClock {
    pub(super) fn read() -> HostClock {
        let ns = |clock| {
            let time = clock_gettime(clock);
            time.tv_sec as u64 * equipoise_core::time::NS_PER_S + time.tv_nsec as u64
        };
        HostClock { monotonic_ns: ns(ClockId::Monotonic), boottime_ns: ns(ClockId::Boottime) }
    }
}

/// The kernel's clock source, for example `tsc`; `None` if unavailable.
pub(super) fn source() -> Option<String> {
    let text =
        std::fs::read_to_string("/sys/devices/system/clocksource/clocksource0/current_clocksource").ok()?;
    Some(text.trim().to_owned())
}

/// Compares arrival stamps with the cycles that ingested the samples, over one evaluation interval.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct StampCheck {
    /// Number of plausible stamps.
    plausible: u32,
    /// Error of the last implausible stamp: positive in the future, negative in the past.
    offset_ns: Option<i64>,
}

impl StampCheck {
    /// Adds the samples that ingress refused since the last evaluation; `ahead_ns` is how far in the future the last
    /// one was.
    pub(super) fn ingest_refused(&mut self, count: u64, ahead_ns: u64) {
        if count > 0 {
            self.offset_ns = Some(ahead_ns.min(i64::MAX as u64) as i64);
        }
    }

    /// Adds one cycle record.
    pub(super) fn ingest(&mut self, record: &CycleRecord) {
        let streams =
            [(record.suit_taken, record.suit_arrival_ns), (record.ground_taken, record.ground_arrival_ns)];
        for (_, arrival_ns) in streams.into_iter().filter(|(ingested, _)| *ingested > 0) {
            let (ahead_ns, age_ns) = (
                arrival_ns.saturating_sub(record.compute_end_ns),
                record.compute_start_ns.saturating_sub(arrival_ns),
            );
            if ahead_ns > AHEAD_NS {
                self.offset_ns = Some(ahead_ns.min(i64::MAX as u64) as i64);
            } else if age_ns > OLD_NS {
                self.offset_ns = Some(-(age_ns.min(i64::MAX as u64) as i64));
            } else {
                self.plausible += 1;
            }
        }
    }
}

/// Monitors the clocks.
#[derive(Debug, Default)]
pub(super) struct ClockMonitor {
    /// CLOCK_BOOTTIME minus CLOCK_MONOTONIC.
    total_suspended_ns: Option<u64>,
    first_source: Option<String>,
    source: Option<String>,
    unsynchronised_ns: u64,
    offset_duration_ns: u64,
    offset_ns: i64,
}

impl ClockMonitor {
    /// Updates the clocks; returns the duration of a suspension since the last call, if any.
    pub(super) fn tick(&mut self, clock: HostClock) -> Option<u64> {
        let total_suspended_ns = clock.boottime_ns.saturating_sub(clock.monotonic_ns);
        let suspended_ns =
            total_suspended_ns.saturating_sub(self.total_suspended_ns.unwrap_or(total_suspended_ns));
        if suspended_ns < SUSPENDED_MIN_NS && self.total_suspended_ns.is_some() {
            return None;
        }
        self.total_suspended_ns = Some(total_suspended_ns);
        (suspended_ns > 0).then_some(suspended_ns)
    }

    /// Updates the kernel's clock source.
    pub(super) fn set_source(&mut self, source: Option<String>) {
        if self.first_source.is_none() {
            self.first_source.clone_from(&source);
        }
        self.source = source;
    }

    /// Adds the observations of one evaluation interval.
    pub(super) fn ingest(
        &mut self,
        unsynchronised: bool,
        has_samples: bool,
        stamps: StampCheck,
        gap_ns: u64,
    ) {
        match (has_samples, unsynchronised) {
            (true, true) => self.unsynchronised_ns += gap_ns,
            (true, false) => self.unsynchronised_ns = 0,
            // Without a sample the synchronisation state is unchanged.
            (false, _) => {}
        }
        match stamps {
            StampCheck { offset_ns: Some(offset_ns), plausible: _ } => {
                self.offset_ns = offset_ns;
                self.offset_duration_ns += gap_ns;
            }
            StampCheck { plausible: 1.., .. } => self.offset_duration_ns = 0,
            StampCheck { .. } => {}
        }
    }

    /// The current clock fault and its remedy.
    pub(super) fn fault(&self) -> Option<String> {
        if let (Some(first), Some(now)) = (&self.first_source, &self.source)
            && first != now
        {
            return Some(format!(
                "the kernel's clock source was {first} and is {now} now: the kernel does not trust the first any more \
                 (dmesg says why); times are right but coarse and slow to read: restart the computer"
            ));
        }
        if self.offset_duration_ns >= STAMP_FAULT_AFTER_NS {
            let seconds = seconds(self.offset_ns.unsigned_abs());
            let direction = if self.offset_ns > 0 { "in the future" } else { "ago" };
            return Some(format!(
                "samples have the arrival time of {seconds:.1} s {direction}: their adapter runs on another clock (another \
                 time namespace or container); run it next to the daemon"
            ));
        }
        (self.unsynchronised_ns >= UNSYNCHRONISED_AFTER_NS).then(|| {
            "the times of suit and plate have been uncertain for ten seconds. If the latency between them \
             has changed: move without a load, and set latency_ms as `equipoise status` prints it. \
             If a device's counter jumps or its rate drifts: restart the device's stream"
                .to_owned()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    const GAP_NS: u64 = 50_000_000;

    fn stamps(arrival_ns: u64) -> StampCheck {
        let mut stamps = StampCheck::default();
        stamps.ingest(&CycleRecord {
            suit_taken: 1,
            suit_arrival_ns: arrival_ns,
            compute_start_ns: 20_000_000_000,
            compute_end_ns: 20_000_100_000,
            ..CycleRecord::zeroed()
        });
        stamps
    }

    #[test]
    fn suspend_time_is_boottime_minus_monotonic() {
        let mut monitor = ClockMonitor::default();
        let at = |monotonic_s: u64, total_suspended_ns: u64| HostClock {
            monotonic_ns: monotonic_s * 1_000_000_000,
            boottime_ns: monotonic_s * 1_000_000_000 + total_suspended_ns,
        };
        assert_eq!(monitor.tick(at(100, 7_000_000_000)), None, "sleep before the start is ignored");
        assert_eq!(monitor.tick(at(101, 7_000_030_000)), None);
        assert_eq!(monitor.tick(at(102, 67_000_000_000)), Some(60_000_000_000));
        assert_eq!(monitor.tick(at(103, 67_000_000_000)), None, "reported once");
    }

    #[test]
    fn a_changed_clock_source_is_reported_until_it_is_restored() {
        let mut monitor = ClockMonitor::default();
        monitor.set_source(Some("tsc".to_owned()));
        assert_eq!(monitor.fault(), None);
        monitor.set_source(Some("hpet".to_owned()));
        assert!(monitor.fault().unwrap().contains("was tsc and is hpet"));
        monitor.set_source(None);
        assert_eq!(monitor.fault(), None, "an unknown source is not a change");
        monitor.set_source(Some("tsc".to_owned()));
        assert_eq!(monitor.fault(), None);
    }

    #[test]
    fn stamps_of_another_clock_are_reported_after_two_seconds() {
        for (arrival_ns, text) in [(90_000_000_000, "in the future"), (1_000_000_000, "ago")] {
            let mut monitor = ClockMonitor::default();
            for _ in 0..39 {
                monitor.ingest(false, true, stamps(arrival_ns), GAP_NS);
                // An interval without samples has no effect.
                monitor.ingest(false, false, StampCheck::default(), GAP_NS);
            }
            assert_eq!(monitor.fault(), None, "a process that stood still catches up");
            monitor.ingest(false, true, stamps(arrival_ns), GAP_NS);
            assert!(monitor.fault().unwrap().contains(text), "{:?}", monitor.fault());
            monitor.ingest(false, true, stamps(19_990_000_000), GAP_NS);
            assert_eq!(monitor.fault(), None);
        }
    }

    #[test]
    fn an_unsynchronised_counter_is_reported_after_ten_seconds_of_samples() {
        let mut monitor = ClockMonitor::default();
        let updates = (0..1000)
            .take_while(|_| {
                monitor.ingest(true, true, stamps(19_990_000_000), GAP_NS);
                monitor.fault().is_none()
            })
            .count();
        assert_eq!(updates, 199);
        monitor.ingest(true, false, StampCheck::default(), GAP_NS);
        assert!(monitor.fault().is_some(), "silence mends nothing");
        monitor.ingest(false, true, stamps(19_990_000_000), GAP_NS);
        assert_eq!(monitor.fault(), None);
    }
}
