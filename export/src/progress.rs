//! Progress of an export.

use std::fmt;

/// Smallest change that is reported, as a fraction.
const STEP: f64 = 0.001;

/// Reports what is being done and which fraction of it is complete.
pub struct Progress<'a> {
    report: &'a mut dyn FnMut(&'static str, f64),
    doing: &'static str,
    reported: f64,
}

impl<'a> Progress<'a> {
    /// `report` receives the task and the completed fraction, 0 to 1.
    pub fn new(report: &'a mut dyn FnMut(&'static str, f64)) -> Progress<'a> {
        Progress { report, doing: "", reported: 0.0 }
    }

    /// Begins a task.
    pub(crate) fn begin(&mut self, doing: &'static str) {
        (self.doing, self.reported) = (doing, 0.0);
        (self.report)(doing, 0.0);
    }

    /// Reports the completed fraction, if it has changed enough.
    pub(crate) fn update(&mut self, fraction: f64) {
        if fraction - self.reported >= STEP {
            self.reported = fraction;
            (self.report)(self.doing, fraction);
        }
    }
}

impl fmt::Debug for Progress<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Progress").field("doing", &self.doing).field("reported", &self.reported).finish()
    }
}
