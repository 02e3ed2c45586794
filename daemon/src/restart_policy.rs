//! Restarts an adapter that fails after its first successful start, with increasing pauses.

use std::any::Any;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::time::Duration;

use tracing::info;

/// First pause before a restart: short, for a brief fault of the device.
const PAUSE_MIN: Duration = Duration::from_millis(250);
/// Longest pause: limits the attempts while a port or network is gone for minutes, yet detects its return soon.
const PAUSE_MAX: Duration = Duration::from_secs(8);
/// Reset the back-off after this much uptime.
const RESET_UPTIME: Duration = Duration::from_secs(30);

/// The environment of [`run_with_restarts`]; replaced in tests.
pub struct Environment<'a> {
    /// Time since a fixed instant.
    pub now: &'a dyn Fn() -> Duration,
    /// Waits until the time has passed or a stop is requested.
    pub wait: &'a dyn Fn(Duration),
    /// Whether a stop was requested.
    pub stopping: &'a dyn Fn() -> bool,
    /// Called with reason and next step when the adapter fails, and with `None` once it works again.
    pub down: &'a dyn Fn(Option<&str>),
}

/// Runs `run` until a stop is requested. `run` receives a callback to call once it works; a first run that ends before
/// is not retried. Every later end (error, panic or return) is followed by a new run after a pause that doubles from
/// 0.25 s to 8 s, and is reset after 30 s of uptime.
///
/// # Errors
/// The error of a first run that ended before it worked.
pub fn run_with_restarts<E: Display>(
    name: &str,
    environment: &Environment<'_>,
    mut run: impl FnMut(&mut dyn FnMut()) -> Result<(), E>,
) -> Result<(), E> {
    let mut pause = PAUSE_MIN;
    let mut has_worked = false;
    while !(environment.stopping)() {
        let mut worked_since = None;
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            run(&mut || {
                worked_since = Some((environment.now)());
                (environment.down)(None);
            })
        }));
        if (environment.stopping)() {
            return outcome.unwrap_or_else(|panic| resume_unwind(panic));
        }
        has_worked |= worked_since.is_some();
        let reason = match outcome {
            Err(panic) if !has_worked => resume_unwind(panic),
            Err(panic) => format!("it panicked: {}", panic_message(&*panic)),
            Ok(Err(error)) if !has_worked => return Err(error),
            Ok(Err(error)) => error.to_string(),
            Ok(Ok(())) => "it ended of itself".to_owned(),
        };
        if worked_since.is_some_and(|since| (environment.now)().saturating_sub(since) >= RESET_UPTIME) {
            pause = PAUSE_MIN;
        }
        let message = format!("the {name} adapter is down: {reason}; it is started again in {pause:?}");
        info!("{message}");
        (environment.down)(Some(&message));
        (environment.wait)(pause);
        pause = (2 * pause).min(PAUSE_MAX);
    }
    Ok(())
}

fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it did not say why")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::{Cell, RefCell};

    /// An environment whose time advances only through its `wait`.
    struct SimulatedAdapter {
        now: Cell<Duration>,
        ends_at: Duration,
        reported: RefCell<Vec<Option<String>>>,
        starts: RefCell<Vec<Duration>>,
    }

    impl SimulatedAdapter {
        fn until(ends_at: Duration) -> SimulatedAdapter {
            SimulatedAdapter {
                now: Cell::default(),
                ends_at,
                reported: RefCell::default(),
                starts: RefCell::default(),
            }
        }

        /// An adapter whose n-th start executes `act`.
        fn run_with_restarts(
            &self,
            mut act: impl FnMut(usize, &mut dyn FnMut()) -> Result<(), String>,
        ) -> Result<(), String> {
            let environment = Environment {
                now: &|| self.now.get(),
                wait: &|time| self.now.set((self.now.get() + time).min(self.ends_at)),
                stopping: &|| self.now.get() >= self.ends_at,
                down: &|reason| self.reported.borrow_mut().push(reason.map(str::to_owned)),
            };
            run_with_restarts("suit", &environment, |ready| {
                let count = self.starts.borrow().len();
                self.starts.borrow_mut().push(self.now.get());
                act(count, ready)
            })
        }

        fn run_for(&self, time: Duration) {
            self.now.set(self.now.get() + time);
        }

        /// Times between successive starts; equal to the pauses if the runs take no time.
        fn pauses_ms(&self) -> Vec<u128> {
            self.starts.borrow().windows(2).map(|pair| (pair[1] - pair[0]).as_millis()).collect()
        }
    }

    #[test]
    fn the_error_of_a_failed_first_start_is_returned() {
        let adapter = SimulatedAdapter::until(Duration::from_secs(100));
        assert_eq!(
            adapter.run_with_restarts(|_, _| Err("port taken".to_owned())),
            Err("port taken".to_owned())
        );
        assert_eq!(adapter.starts.borrow().len(), 1);
        assert!(adapter.reported.borrow().is_empty());
    }

    #[test]
    fn repeated_failures_and_panics_lengthen_the_pause_before_a_restart() {
        let adapter = SimulatedAdapter::until(Duration::from_secs(40));
        let outcome = adapter.run_with_restarts(|count, ready| {
            if count == 0 {
                ready();
            }
            match count % 3 {
                0 => Err("no socket".to_owned()),
                1 => panic!("index out of bounds"),
                _ => Ok(()),
            }
        });
        assert_eq!(outcome, Ok(()));
        assert_eq!(adapter.pauses_ms(), [250, 500, 1000, 2000, 4000, 8000, 8000, 8000, 8000]);
        let reported = adapter.reported.borrow();
        let assert_message = |index: usize, text: &str| {
            let message = reported[index].as_deref().unwrap();
            assert!(message.contains(text) && message.contains("started again"), "{message}");
        };
        assert_eq!(reported[0], None);
        assert_message(1, "no socket");
        assert_message(2, "it panicked: index out of bounds");
        assert_message(3, "it ended of itself");
    }

    #[test]
    fn thirty_seconds_of_uptime_reset_the_pause() {
        let adapter = SimulatedAdapter::until(Duration::from_secs(100));
        let outcome = adapter.run_with_restarts(|count, ready| {
            ready();
            let lasts_s = [0, 0, 0, 29, 30, 0, 100][count];
            adapter.run_for(Duration::from_secs(lasts_s));
            Err("gone".to_owned())
        });
        // A stop request during a run: the run's result is returned.
        assert_eq!(outcome, Err("gone".to_owned()));
        let without_uptime: Vec<u128> = adapter
            .pauses_ms()
            .iter()
            .zip([0, 0, 0, 29_000, 30_000, 0])
            .map(|(all, ran)| all - ran)
            .collect();
        assert_eq!(without_uptime, [250, 500, 1000, 2000, 250, 500]);
    }

    #[test]
    fn a_stop_request_ends_a_pause() {
        let adapter = SimulatedAdapter::until(Duration::from_millis(700));
        assert_eq!(
            adapter.run_with_restarts(|_, ready| {
                ready();
                Err("gone".to_owned())
            }),
            Ok(())
        );
        assert_eq!(adapter.starts.borrow().len(), 2);
        assert_eq!(adapter.now.get(), Duration::from_millis(700));
    }
}
