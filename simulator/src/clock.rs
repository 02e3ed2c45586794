//! CLOCK_MONOTONIC, read and slept on by absolute times, so that pacing never drifts; and the clocks of devices, with
//! drift, steps and restarts.

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

const NS_PER_S: u64 = 1_000_000_000;

/// The time now, ns.
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    // The monotonic clock counts from boot: neither part is ever negative.
    now.tv_sec as u64 * NS_PER_S + now.tv_nsec as u64
}

/// Sleeps until a time; returns at once if it is past.
pub fn sleep_until_ns(time_ns: u64) {
    let due = Timespec { tv_sec: (time_ns / NS_PER_S) as i64, tv_nsec: (time_ns % NS_PER_S) as i64 };
    // A signal may interrupt the sleep.
    while clock_nanosleep_absolute(ClockId::Monotonic, &due).is_err() && monotonic_ns() < time_ns {}
}

/// A span of seconds in whole nanoseconds; negative spans become zero.
pub fn span_ns(seconds: f64) -> u64 {
    (seconds * NS_PER_S as f64).round() as u64
}

/// Times and counts of a device's samples. As in the simulated devices, device time follows from the counter and is
/// independent of true time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeviceClock {
    rate_hz: f64,
    /// Samples since the last change of rate, and its time.
    since: (u32, f64),
    counter: u32,
}

impl DeviceClock {
    /// A device that counts from 0 at simulated time 0.
    pub fn new(rate_hz: f64) -> DeviceClock {
        DeviceClock { rate_hz, since: (0, 0.0), counter: 0 }
    }

    /// Due time of the current sample, s.
    pub fn time_s(&self) -> f64 {
        self.since.1 + f64::from(self.since.0) / self.rate_hz
    }

    /// The device's number of the current sample.
    pub fn counter(&self) -> u32 {
        self.counter
    }

    /// Present sample rate, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Advances to the next sample at this rate.
    pub fn advance(&mut self, rate_hz: f64) {
        if rate_hz == self.rate_hz {
            self.since.0 += 1;
        } else {
            self.since = (1, self.time_s());
            self.rate_hz = rate_hz;
        }
        self.counter = self.counter.wrapping_add(1);
    }

    /// The counter jumps forward or back; time does not.
    pub fn leap(&mut self, by: i32) {
        self.counter = self.counter.wrapping_add_signed(by);
    }

    /// Power cycle: the counter restarts at 0.
    pub fn restart(&mut self) {
        self.counter = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_device_counts_its_time() {
        let mut clock = DeviceClock::new(60.0);
        for number in 0..1000_u32 {
            assert_eq!((clock.counter(), clock.time_s()), (number, f64::from(number) / 60.0));
            clock.advance(60.0);
        }
    }

    #[test]
    fn time_goes_on_through_every_change_of_pace_and_count() {
        let mut clock = DeviceClock::new(60.0);
        let mut before_s = 0.0;
        for number in 1..600 {
            let rate_hz = if number % 200 < 100 { 60.0 } else { 100.0 };
            clock.advance(rate_hz);
            let step_s = clock.time_s() - before_s;
            assert!((step_s - 1.0 / rate_hz).abs() < 1e-9, "{number}: {step_s}");
            before_s = clock.time_s();
            match number {
                250 => clock.leap(5000),
                300 => clock.leap(-100),
                400 => clock.restart(),
                _ => {}
            }
        }
        assert_eq!(clock.counter(), 199);
    }
}
