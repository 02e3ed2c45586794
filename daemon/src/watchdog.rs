//! Notifies the service manager's watchdog while cycles complete. The thread does nothing else: housekeeping reads and
//! writes files, and a slow disk must not end a daemon whose loop runs.

use std::time::{Duration, Instant};

use crate::rings::Rings;

/// Interval between notifications; the shipped unit allows five seconds.
const NOTIFY_EVERY: Duration = Duration::from_secs(1);
/// Polling interval for completed cycles and the end of the loop.
const POLL_EVERY: Duration = Duration::from_millis(50);

/// Runs until the loop has ended.
pub fn run(rings: &Rings) {
    notify_while_cycles_complete(rings, NOTIFY_EVERY, || {
        let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
    });
}

fn notify_while_cycles_complete(rings: &Rings, every: Duration, mut notify: impl FnMut()) {
    let mut last_notified = Instant::now();
    let mut last_cycle = 0;
    while !rings.has_ended() {
        std::thread::sleep(POLL_EVERY);
        let cycle = rings.last_cycle();
        if cycle != last_cycle && last_notified.elapsed() >= every {
            (last_notified, last_cycle) = (Instant::now(), cycle);
            notify();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::thread::{JoinHandle, sleep, spawn};

    use bytemuck::Zeroable;
    use equipoise_core::message::{CycleRecord, State};

    use super::*;
    use crate::rings::Outcome;

    fn complete(rings: &Rings, cycle: u64) {
        let state = State { cycle, ..State::zeroed() };
        rings.push_outcome(Outcome { state, record: CycleRecord::zeroed() });
    }

    fn watchdog(rings: &Arc<Rings>, every: Duration) -> (JoinHandle<()>, Arc<AtomicU64>) {
        let count = Arc::new(AtomicU64::new(0));
        let (rings, counted) = (Arc::clone(rings), Arc::clone(&count));
        let notify = move || {
            counted.fetch_add(1, Ordering::Relaxed);
        };
        (spawn(move || notify_while_cycles_complete(&rings, every, notify)), count)
    }

    #[test]
    fn a_stalled_loop_is_not_reported_as_alive() {
        let rings = Arc::new(Rings::new().unwrap());
        let (thread, count) = watchdog(&rings, Duration::ZERO);
        sleep(POLL_EVERY * 4);
        assert_eq!(count.load(Ordering::Relaxed), 0, "no cycle has completed yet");
        for cycle in 1..=3 {
            complete(&rings, cycle);
            while count.load(Ordering::Relaxed) < cycle {
                sleep(Duration::from_millis(1));
            }
            // The loop stalls.
            sleep(POLL_EVERY * 4);
            assert_eq!(count.load(Ordering::Relaxed), cycle);
        }
        rings.stop();
        thread.join().unwrap();
    }

    #[test]
    fn the_interval_holds_for_a_running_loop() {
        let rings = Arc::new(Rings::new().unwrap());
        let every = Duration::from_millis(200);
        let started = Instant::now();
        let (thread, count) = watchdog(&rings, every);
        let mut cycle = 0;
        while count.load(Ordering::Relaxed) < 3 {
            cycle += 1;
            complete(&rings, cycle);
            sleep(Duration::from_millis(1));
        }
        assert!(started.elapsed() >= every * 3, "{:?}", started.elapsed());
        rings.stop();
        thread.join().unwrap();
    }
}
