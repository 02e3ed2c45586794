//! Notifies the service manager's watchdog while cycles complete. The thread does nothing else: housekeeping reads and
//! writes files, and a slow disk must not end a daemon whose loop runs.

use std::time::{Duration, Instant};

use crossbeam_channel::{select, tick};

use crate::rings::LoopControl;

/// Interval between notifications; the shipped unit allows five seconds.
const NOTIFY_EVERY: Duration = Duration::from_secs(1);
/// Polling interval for completed cycles: the loop wakes no thread for them.
const POLL_EVERY: Duration = Duration::from_millis(50);

/// Runs until the loop has ended.
pub fn run(control: &LoopControl) {
    notify_while_cycles_complete(control, NOTIFY_EVERY, || {
        let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
    });
}

fn notify_while_cycles_complete(control: &LoopControl, every: Duration, mut notify: impl FnMut()) {
    let mut last_notified = Instant::now();
    let mut last_cycle = 0;
    let ticks = tick(POLL_EVERY);
    loop {
        select! {
            recv(ticks) -> _ => {}
            recv(control.ended()) -> _ => return,
        }
        let cycle = control.last_cycle();
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
    use crate::rings::{LoopEnds, Outcome, Rings};

    fn complete(loop_ends: &mut LoopEnds, cycle: u64) {
        let state = State { cycle, ..State::zeroed() };
        loop_ends.push_outcome(Outcome { state, record: CycleRecord::zeroed() });
    }

    fn watchdog(control: &Arc<LoopControl>, every: Duration) -> (JoinHandle<()>, Arc<AtomicU64>) {
        let count = Arc::new(AtomicU64::new(0));
        let (control, counted) = (Arc::clone(control), Arc::clone(&count));
        let notify = move || {
            counted.fetch_add(1, Ordering::Relaxed);
        };
        (spawn(move || notify_while_cycles_complete(&control, every, notify)), count)
    }

    #[test]
    fn a_stalled_loop_is_not_reported_as_alive() {
        let Rings { control, mut loop_ends, .. } = Rings::new().unwrap();
        let (thread, count) = watchdog(&control, Duration::ZERO);
        sleep(POLL_EVERY * 4);
        assert_eq!(count.load(Ordering::Relaxed), 0, "no cycle has completed yet");
        for cycle in 1..=3 {
            complete(&mut loop_ends, cycle);
            while count.load(Ordering::Relaxed) < cycle {
                sleep(Duration::from_millis(1));
            }
            // The loop stalls.
            sleep(POLL_EVERY * 4);
            assert_eq!(count.load(Ordering::Relaxed), cycle);
        }
        control.stop();
        thread.join().unwrap();
    }

    #[test]
    fn the_interval_holds_for_a_running_loop() {
        let Rings { control, mut loop_ends, .. } = Rings::new().unwrap();
        let every = Duration::from_millis(200);
        let started = Instant::now();
        let (thread, count) = watchdog(&control, every);
        let mut cycle = 0;
        while count.load(Ordering::Relaxed) < 3 {
            cycle += 1;
            complete(&mut loop_ends, cycle);
            sleep(Duration::from_millis(1));
        }
        assert!(started.elapsed() >= every * 3, "{:?}", started.elapsed());
        control.stop();
        thread.join().unwrap();
    }
}
