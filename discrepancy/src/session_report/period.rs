//! The part of a session with one worker and one dose.

use equipoise_core::message::State;
use equipoise_core::overload::Level;

use super::back::Back;
use super::exposure::{Exposure, JointExposure};
use super::lifts::Lifts;
use super::quality::Quality;

/// Why a period began.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// The worker changed.
    Worker,
    /// The profile of the same worker was loaded.
    Load,
    /// A new shift of the same worker, or a restart of the daemon that lost lifts.
    Shift,
}

/// Exposure, lifts and low back of one worker in one shift.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Period {
    /// Why it began; `None` for the start of the recording.
    pub cause: Option<Cause>,
    /// Pseudonym of the worker; `None` if unnamed.
    pub subject: Option<String>,
    /// Times of the first and last state, s since the beginning of the recording.
    pub span_s: Option<[f64; 2]>,
    /// Exposure of the joints.
    pub exposure: Exposure,
    /// Lifts.
    pub lifts: Lifts,
    /// Low back, load, dose.
    pub back: Back,
    /// Quality of the data.
    pub quality: Quality,
}

impl Period {
    /// A period without states on a walking surface at this height in the world, m.
    pub fn on(surface_z_m: f64, cause: Option<Cause>, subject: Option<String>) -> Period {
        Period { cause, subject, lifts: Lifts::on(surface_z_m), ..Period::default() }
    }

    /// Adds one state, which represents `step_s`.
    pub fn ingest(&mut self, state: &State, time_s: f64, step_s: f64) {
        let [from_s, _] = self.span_s.unwrap_or([time_s; 2]);
        self.span_s = Some([from_s, time_s]);
        self.exposure.ingest(state, time_s, step_s);
        self.lifts.ingest(state, time_s, step_s);
        self.back.ingest(state, time_s, step_s);
        self.quality.ingest(state, step_s);
    }

    /// The longest time of a joint at the levels high and overloaded, s.
    pub fn high_s(&self) -> f64 {
        let high_s = |joint: &JointExposure| joint.at(Level::Red) + joint.at(Level::AboveMax);
        self.exposure.joints.iter().map(high_s).fold(0.0, f64::max)
    }
}
