//! What all outlets have in common: the newest state, at a rate, until told to stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use equipoise_client::{Consumer, ConsumerSettings, NoReading};
use tracing::{info, warn};

use crate::outlet::Outlet;

/// How often the log and the service manager hear of what was told.
const SAY_EVERY: Duration = Duration::from_secs(60);
/// The longest that is slept at once: a beat may be ten seconds away, and whoever stops it waits.
const SLEEP_MAX: Duration = Duration::from_millis(200);
/// How often the watchdog is fed, while beats go out or the next one is waited for; never from within a beat.
const PING_EVERY: Duration = Duration::from_secs(1);

/// Beats at a rate that does not drift; what is missed is skipped, not made up for.
#[derive(Debug, Clone, Copy)]
pub struct Beats {
    period: Duration,
    due: Instant,
}

impl Beats {
    /// The first beat is at `start`.
    pub fn new(rate_hz: f64, start: Instant) -> Beats {
        Beats { period: Duration::from_secs_f64(1.0 / rate_hz), due: start }
    }

    /// The time to sleep until the next beat; zero if it is overdue.
    pub fn wait(&self, now: Instant) -> Duration {
        self.due.saturating_duration_since(now)
    }

    /// A beat is done: the next one is the first that lies ahead.
    pub fn done(&mut self, now: Instant) {
        let late = now.saturating_duration_since(self.due);
        let periods = (late.as_nanos() / self.period.as_nanos().max(1)) as u32 + 1;
        self.due += self.period * periods;
    }
}

/// Tells an outlet at `rate_hz` what the station knows, until `stop`. `role` is its name on the bus.
///
/// Every beat tells the newest state there is: of a loop that is slower than the beat some are told more than once
/// (`Reading::is_new`), each time older. The daemon need not run: the outlet is told so, and of states again when there are
/// some.
///
/// # Errors
/// What [`Consumer::join_with`] says: another release's services, or no place left for a reader.
pub fn drive(
    station: &str,
    role: &str,
    rate_hz: f64,
    outlet: &mut dyn Outlet,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let settings = ConsumerSettings { depth: 1, ..ConsumerSettings::new(station, role) };
    // Only the first beat waits for a state: whoever has heard of none for so long has none.
    let patience = settings.stale_after;
    let mut consumer = Consumer::join_with(settings)?;
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
    let mut first = Some(consumer.next(patience));
    let (mut beats, mut pinged, mut said) =
        (Beats::new(rate_hz, Instant::now()), Instant::now(), Instant::now());
    let mut trouble = None;
    while !stop.load(Ordering::Relaxed) {
        let wait = beats.wait(Instant::now());
        std::thread::sleep(wait.min(SLEEP_MAX));
        if pinged.elapsed() >= PING_EVERY {
            pinged = Instant::now();
            let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
        }
        if wait > SLEEP_MAX {
            continue;
        }
        // A beat faster than the loop tells a state again, older than before, until it is too old.
        let seen = first.take().unwrap_or_else(|| consumer.latest());
        outlet.tell(&seen);
        tell_change(&mut trouble, seen.err());
        let now = Instant::now();
        beats.done(now);
        if now - said >= SAY_EVERY {
            said = now;
            let tally = outlet.tally().to_string();
            let _ = sd_notify::notify(&[sd_notify::NotifyState::Status(&tally)]);
            info!("{tally}");
        }
    }
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Stopping]);
    Ok(())
}

/// A reason is said when it begins and when it ends, not at every beat.
fn tell_change(before: &mut Option<NoReading>, now: Option<NoReading>) {
    match (before.as_ref(), now.as_ref()) {
        (None, Some(reason)) => warn!("no state: {reason}"),
        (Some(before), Some(reason)) if std::mem::discriminant(before) != std::mem::discriminant(reason) => {
            warn!("no state: {reason}");
        }
        (Some(_), None) => info!("states come again"),
        _ => {}
    }
    *before = now;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beats_keep_their_phase_and_what_was_missed_is_skipped() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut beats = Beats::new(100.0, start);
        assert_eq!(beats.wait(at(0)), Duration::ZERO);
        beats.done(at(3));
        assert_eq!(beats.wait(at(3)), Duration::from_millis(7));
        beats.done(at(45));
        assert_eq!(beats.wait(at(45)), Duration::from_millis(5));
        assert_eq!(beats.wait(at(60)), Duration::ZERO);
    }
}
