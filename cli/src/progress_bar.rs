//! Progress bar on a terminal.

use std::io::IsTerminal;
use std::time::Duration;

use crossbeam_channel::RecvTimeoutError;
use equipoise_recording::replay::input::Input;
use indicatif::{ProgressBar, ProgressStyle};

/// Length of the bar.
const STEPS: f64 = 1000.0;
/// Interval between two updates.
const INTERVAL: Duration = Duration::from_millis(100);
/// A larger step back, as a fraction, is the begin of another pass.
const STEP_BACK: f64 = 0.1;

/// A bar on standard error; nothing is shown unless that is a terminal. Dropping it removes it.
pub(crate) struct Bar(Option<ProgressBar>);

impl Bar {
    /// A bar, or none if `is_quiet`.
    pub(crate) fn new(is_quiet: bool) -> Bar {
        let is_interactive = !is_quiet && std::io::stderr().is_terminal();
        Bar(is_interactive.then(|| {
            let style = ProgressStyle::with_template("{spinner} {msg:<28} {wide_bar} {percent:>3} % {eta}");
            let bar = ProgressBar::new(STEPS as u64)
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(2 * INTERVAL);
            bar
        }))
    }

    /// Shows the task and its completed fraction, 0 to 1.
    pub(crate) fn update(&self, doing: &'static str, fraction: f64) {
        if let Some(bar) = &self.0 {
            let at = (STEPS * fraction.clamp(0.0, 1.0)) as u64;
            let is_other = bar.message() != doing;
            if is_other {
                bar.set_message(doing);
            }
            if is_other || at + ((STEPS * STEP_BACK) as u64) < bar.position() {
                bar.reset_eta();
            }
            bar.set_position(at);
        }
    }

    /// Runs `work`, and shows meanwhile which fraction of the input its present pass has read.
    pub(crate) fn follow<T>(&self, doing: &'static str, input: &Input, work: impl FnOnce() -> T) -> T {
        if self.0.is_none() {
            return work();
        }
        let (running, ended) = crossbeam_channel::bounded::<()>(0);
        std::thread::scope(|scope| {
            scope.spawn(move || {
                self.update(doing, 0.0);
                while ended.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                    self.update(doing, input.fraction_read());
                }
            });
            // Moved in, so that the display ends with the work, even by a panic.
            let _running = running;
            work()
        })
    }

    /// Removes the bar.
    pub(crate) fn clear(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.clear();
    }
}
