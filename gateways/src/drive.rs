//! Common part of all gateways: publishes the newest state at a fixed rate until stopped.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use equipoise_client::{Consumer, ConsumerSettings, NoReading};
use tracing::{info, warn};

use crate::gateway::Gateway;

/// How often the tally is logged and reported to the service manager.
const LOG_EVERY: Duration = Duration::from_secs(60);
/// Longest single sleep: the next tick may be ten seconds away, and a stop must take effect soon.
const SLEEP_MAX: Duration = Duration::from_millis(200);
/// How often the watchdog is notified while ticks go out or the next one is awaited; never within a tick, so that a
/// hanging gateway is detected.
const WATCHDOG_EVERY: Duration = Duration::from_secs(1);

/// Schedule of ticks at a rate that does not drift; missed ticks are skipped.
#[derive(Debug, Clone, Copy)]
pub struct Schedule {
    period: Duration,
    due: Instant,
}

impl Schedule {
    /// A schedule with the first tick at `start`.
    pub fn new(rate_hz: f64, start: Instant) -> Schedule {
        Schedule { period: Duration::from_secs_f64(1.0 / rate_hz), due: start }
    }

    /// Time until the next tick; zero if it is overdue.
    pub fn wait(&self, now: Instant) -> Duration {
        self.due.saturating_duration_since(now)
    }

    /// Marks the tick as done and schedules the next one after `now`.
    pub fn done(&mut self, now: Instant) {
        let late = now.saturating_duration_since(self.due);
        let periods = (late.as_nanos() / self.period.as_nanos().max(1)) as u32 + 1;
        self.due += self.period * periods;
    }
}

/// Passes the newest state to a gateway at `rate_hz`, until `stop`. `role` is its name on the bus.
///
/// Every tick passes the newest state. If the loop is slower than the ticks, some states are passed more than once
/// (`Reading::is_new`), with increasing age. The daemon need not run: the gateway then gets the reason, and states
/// again as soon as there are any.
///
/// # Errors
/// Those of [`Consumer::join_with`]: services of another release, or no free place for a reader.
pub fn drive(
    station: &str,
    role: &str,
    rate_hz: f64,
    gateway: &mut dyn Gateway,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let settings = ConsumerSettings { depth: 1, ..ConsumerSettings::new(station, role) };
    // Only the first tick waits for a state; after this time there is none.
    let patience = settings.stale_after;
    let mut consumer = Consumer::join_with(settings)?;
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
    let mut first = Some(consumer.next(patience));
    let (mut schedule, mut notified, mut logged) =
        (Schedule::new(rate_hz, Instant::now()), Instant::now(), Instant::now());
    let mut missing = None;
    while !stop.load(Ordering::Relaxed) {
        let wait = schedule.wait(Instant::now());
        std::thread::sleep(wait.min(SLEEP_MAX));
        if notified.elapsed() >= WATCHDOG_EVERY {
            notified = Instant::now();
            let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
        }
        if wait > SLEEP_MAX {
            continue;
        }
        // If ticks are faster than the loop, the same state is passed again, with a larger age, until it is too old.
        let latest = first.take().unwrap_or_else(|| consumer.latest());
        gateway.send(&latest);
        log_change(&mut missing, latest.err());
        let now = Instant::now();
        schedule.done(now);
        if now - logged >= LOG_EVERY {
            logged = now;
            let tally = gateway.tally().to_string();
            let _ = sd_notify::notify(&[sd_notify::NotifyState::Status(&tally)]);
            info!("{tally}");
        }
    }
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Stopping]);
    Ok(())
}

/// Logs a missing state when it begins and when it ends, not at every tick.
fn log_change(before: &mut Option<NoReading>, now: Option<NoReading>) {
    match (before.as_ref(), now.as_ref()) {
        (None, Some(reason)) => warn!("no state: {reason}"),
        (Some(before), Some(reason)) if std::mem::discriminant(before) != std::mem::discriminant(reason) => {
            warn!("no state: {reason}");
        }
        (Some(_), None) => info!("states are available again"),
        _ => {}
    }
    *before = now;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_schedule_keeps_its_phase_and_skips_missed_ticks() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut schedule = Schedule::new(100.0, start);
        assert_eq!(schedule.wait(at(0)), Duration::ZERO);
        schedule.done(at(3));
        assert_eq!(schedule.wait(at(3)), Duration::from_millis(7));
        schedule.done(at(45));
        assert_eq!(schedule.wait(at(45)), Duration::from_millis(5));
        assert_eq!(schedule.wait(at(60)), Duration::ZERO);
    }
}
