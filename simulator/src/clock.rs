//! CLOCK_MONOTONIC, read and slept on by absolute times, so that pacing never drifts.

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
