//! Detects clock faults: the computer was suspended, its clock source changed, samples have stamps of another clock, or
//! a device's counter is not synchronised with the host's time.

use equipoise_core::message::CycleRecord;
use equipoise_core::time::seconds;
use rustix::time::{ClockId, clock_gettime};

/// CLOCK_BOOTTIME continues while the computer is suspended, CLOCK_MONOTONIC does not. Two successive readings differ
/// by microseconds or a lost time slice; a larger difference than this means a suspension.
const SLEPT_NS: u64 = 200_000_000;
/// A clock fit is available after eight samples; a longer time without one, while samples arrive, is a fault.
const UNSYNCHRONISED_AFTER_NS: u64 = 10_000_000_000;
/// A sample cannot arrive after the cycle that ingested it, except for the offset between two cores' counters, which is
/// below this.
const AHEAD_NS: u64 = 10_000_000;
/// Rings and sockets hold less than this of any stream, so an older sample was stamped by another clock …
const OLD_NS: u64 = 5_000_000_000;
/// … unless this process was stopped; then the stamps become plausible again within this time.
const STAMPS_OFF_AFTER_NS: u64 = 2_000_000_000;

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
pub(super) struct Stamped {
    /// Number of plausible stamps.
    right: u32,
    /// Error of the last implausible stamp: positive in the future, negative in the past.
    off_ns: Option<i64>,
}

impl Stamped {
    /// Adds the samples that ingress refused since the last evaluation; `ahead_ns` is how far in the future the last
    /// one was.
    pub(super) fn see_refused(&mut self, count: u64, ahead_ns: u64) {
        if count > 0 {
            self.off_ns = Some(ahead_ns.min(i64::MAX as u64) as i64);
        }
    }

    /// Adds one cycle record.
    pub(super) fn see(&mut self, record: &CycleRecord) {
        let streams =
            [(record.suit_taken, record.suit_arrival_ns), (record.ground_taken, record.ground_arrival_ns)];
        for (_, arrival_ns) in streams.into_iter().filter(|(taken, _)| *taken > 0) {
            let (ahead_ns, age_ns) = (
                arrival_ns.saturating_sub(record.compute_end_ns),
                record.compute_start_ns.saturating_sub(arrival_ns),
            );
            if ahead_ns > AHEAD_NS {
                self.off_ns = Some(ahead_ns.min(i64::MAX as u64) as i64);
            } else if age_ns > OLD_NS {
                self.off_ns = Some(-(age_ns.min(i64::MAX as u64) as i64));
            } else {
                self.right += 1;
            }
        }
    }
}

/// Monitors the clocks.
#[derive(Debug, Default)]
pub(super) struct ClockWatch {
    /// CLOCK_BOOTTIME minus CLOCK_MONOTONIC.
    asleep_ns: Option<u64>,
    first_source: Option<String>,
    source: Option<String>,
    unsynchronised_ns: u64,
    off_since_ns: u64,
    off_ns: i64,
}

impl ClockWatch {
    /// Updates the clocks; returns the duration of a suspension since the last call, if any.
    pub(super) fn tick(&mut self, clock: HostClock) -> Option<u64> {
        let asleep_ns = clock.boottime_ns.saturating_sub(clock.monotonic_ns);
        let slept_ns = asleep_ns.saturating_sub(self.asleep_ns.unwrap_or(asleep_ns));
        if slept_ns < SLEPT_NS && self.asleep_ns.is_some() {
            return None;
        }
        self.asleep_ns = Some(asleep_ns);
        (slept_ns > 0).then_some(slept_ns)
    }

    /// Updates the kernel's clock source.
    pub(super) fn name_source(&mut self, source: Option<String>) {
        if self.first_source.is_none() {
            self.first_source.clone_from(&source);
        }
        self.source = source;
    }

    /// Adds the observations of one evaluation interval.
    pub(super) fn see(&mut self, unsynchronised: bool, samples_come: bool, stamped: Stamped, gap_ns: u64) {
        match (samples_come, unsynchronised) {
            (true, true) => self.unsynchronised_ns += gap_ns,
            (true, false) => self.unsynchronised_ns = 0,
            // Without a sample the synchronisation state is unchanged.
            (false, _) => {}
        }
        match stamped {
            Stamped { off_ns: Some(off_ns), right: _ } => {
                self.off_ns = off_ns;
                self.off_since_ns += gap_ns;
            }
            Stamped { right: 1.., .. } => self.off_since_ns = 0,
            Stamped { .. } => {}
        }
    }

    /// The current clock fault and its remedy.
    pub(super) fn trouble(&self) -> Option<String> {
        if let (Some(first), Some(now)) = (&self.first_source, &self.source)
            && first != now
        {
            return Some(format!(
                "the kernel's clock source was {first} and is {now} now: the kernel does not trust the first any more \
                 (dmesg says why); times are right but coarse and slow to read: restart the computer"
            ));
        }
        if self.off_since_ns >= STAMPS_OFF_AFTER_NS {
            let seconds = seconds(self.off_ns.unsigned_abs());
            let where_to = if self.off_ns > 0 { "in the future" } else { "ago" };
            return Some(format!(
                "samples have the arrival time of {seconds:.1} s {where_to}: their adapter runs on another clock (another \
                 time namespace or container); run it next to the daemon"
            ));
        }
        (self.unsynchronised_ns >= UNSYNCHRONISED_AFTER_NS).then(|| {
            "samples come, but the device's counter has not been tied to this computer's time for ten seconds: its rate \
             drifts or its counter jumps; restart the device's stream"
                .to_owned()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    const GAP_NS: u64 = 50_000_000;

    fn stamped(arrival_ns: u64) -> Stamped {
        let mut stamped = Stamped::default();
        stamped.see(&CycleRecord {
            suit_taken: 1,
            suit_arrival_ns: arrival_ns,
            compute_start_ns: 20_000_000_000,
            compute_end_ns: 20_000_100_000,
            ..CycleRecord::zeroed()
        });
        stamped
    }

    #[test]
    fn sleep_is_what_boottime_has_more_than_monotonic() {
        let mut watch = ClockWatch::default();
        let at = |monotonic_s: u64, asleep_ns: u64| HostClock {
            monotonic_ns: monotonic_s * 1_000_000_000,
            boottime_ns: monotonic_s * 1_000_000_000 + asleep_ns,
        };
        assert_eq!(watch.tick(at(100, 7_000_000_000)), None, "sleep before the start is ignored");
        assert_eq!(watch.tick(at(101, 7_000_030_000)), None);
        assert_eq!(watch.tick(at(102, 67_000_000_000)), Some(60_000_000_000));
        assert_eq!(watch.tick(at(103, 67_000_000_000)), None, "reported once");
    }

    #[test]
    fn a_changed_clock_source_is_reported_until_it_is_back() {
        let mut watch = ClockWatch::default();
        watch.name_source(Some("tsc".to_owned()));
        assert_eq!(watch.trouble(), None);
        watch.name_source(Some("hpet".to_owned()));
        assert!(watch.trouble().unwrap().contains("was tsc and is hpet"));
        watch.name_source(None);
        assert_eq!(watch.trouble(), None, "an unknown source is not a change");
        watch.name_source(Some("tsc".to_owned()));
        assert_eq!(watch.trouble(), None);
    }

    #[test]
    fn stamps_of_another_clock_must_last() {
        for (arrival_ns, word) in [(90_000_000_000, "in the future"), (1_000_000_000, "ago")] {
            let mut watch = ClockWatch::default();
            for _ in 0..39 {
                watch.see(false, true, stamped(arrival_ns), GAP_NS);
                // An interval without samples has no effect.
                watch.see(false, false, Stamped::default(), GAP_NS);
            }
            assert_eq!(watch.trouble(), None, "a process that stood still catches up");
            watch.see(false, true, stamped(arrival_ns), GAP_NS);
            assert!(watch.trouble().unwrap().contains(word), "{:?}", watch.trouble());
            watch.see(false, true, stamped(19_990_000_000), GAP_NS);
            assert_eq!(watch.trouble(), None);
        }
    }

    #[test]
    fn a_counter_that_is_never_tied_is_reported_after_ten_seconds_of_samples() {
        let mut watch = ClockWatch::default();
        let looks = (0..1000)
            .take_while(|_| {
                watch.see(true, true, stamped(19_990_000_000), GAP_NS);
                watch.trouble().is_none()
            })
            .count();
        assert_eq!(looks, 199);
        watch.see(true, false, Stamped::default(), GAP_NS);
        assert!(watch.trouble().is_some(), "silence mends nothing");
        watch.see(false, true, stamped(19_990_000_000), GAP_NS);
        assert_eq!(watch.trouble(), None);
    }
}
