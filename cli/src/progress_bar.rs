//! Progress bar on a terminal.

use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// A bar on standard error; nothing is shown unless that is a terminal.
pub(crate) struct Bar(Option<ProgressBar>);

impl Bar {
    /// A bar, or none if `is_quiet`.
    pub(crate) fn new(is_quiet: bool) -> Bar {
        let is_interactive = !is_quiet && std::io::stderr().is_terminal();
        Bar(is_interactive.then(|| {
            let style = ProgressStyle::with_template("{msg:<32} {wide_bar} {percent:>3} % {eta}");
            let bar =
                ProgressBar::new(1000).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        }))
    }

    /// Shows the task and its completed fraction, 0 to 1.
    pub(crate) fn update(&self, doing: &'static str, fraction: f64) {
        if let Some(bar) = &self.0 {
            let at = (1000.0 * fraction.clamp(0.0, 1.0)) as u64;
            if bar.message() != doing {
                bar.set_message(doing);
                bar.reset_eta();
            }
            bar.set_position(at);
        }
    }

    /// Removes the bar.
    pub(crate) fn clear(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}
