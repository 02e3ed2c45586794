//! Monitors whether the model still explains the measurements of this subject, about once a second and outside the
//! loop.
//!
//! Evaluates the unloaded samples of an identified subject over the last minute: residual (measured minus predicted)
//! divided by its own σ, separately for static poses and motion. For a correct model the median of the magnitude is 0.7
//! σ; a median of several σ is reported with its signal and pose dependence. A load is not a discrepancy: samples with
//! one are ignored. The watch changes nothing: `equipoise reconcile` finds the cause, and a person decides.

use std::collections::VecDeque;
use std::fmt;

use equipoise_core::body::Segment;
use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use equipoise_core::time::NS_PER_S;

mod pose;

use pose::Limb;

/// Length of the window, ns.
const WINDOW_NS: u64 = 60 * NS_PER_S;
/// Minimum time span in the window for an evaluation, ns.
const SEEN_NS: u64 = 40 * NS_PER_S;
/// Minimum number of samples of one kind for an evaluation.
const MOMENTS_MIN: usize = 15;
/// Median of the residual's magnitude over σ above which the model is rejected. A Gaussian has 0.67; the limit of 3
/// tolerates a σ that is wrong by a factor of four.
const MEDIAN_MAX: f64 = 3.0;
/// Minimum interval between reports, ns.
const SILENCE_NS: u64 = 300 * NS_PER_S;

/// Signal that is monitored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// Centre of pressure, forward.
    CopForward,
    /// Centre of pressure, to the left.
    CopLeft,
    /// Vertical force.
    Force,
}

/// A discrepancy between model and measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suspicion {
    /// The signal concerned.
    pub signal: Signal,
    /// Whether it occurs in static poses (otherwise in motion).
    pub still: bool,
    /// Median of measured minus predicted, m or N.
    pub size: f64,
    /// Median of its magnitude divided by σ.
    pub times_sigma: f64,
    /// The limb whose pose correlates most with the residual, if any.
    pub limb: Option<Limb>,
}

impl fmt::Display for Suspicion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (signal, size) = match self.signal {
            Signal::CopForward | Signal::CopLeft => {
                let mm = 1e3 * self.size;
                let side = match (self.signal, mm < 0.0) {
                    (Signal::CopForward, false) => "before",
                    (Signal::CopForward, true) => "behind",
                    (_, false) => "left of",
                    (_, true) => "right of",
                };
                ("centre of pressure", format!("{:.0} mm {side}", mm.abs()))
            }
            Signal::Force => {
                let side = if self.size < 0.0 { "below" } else { "above" };
                ("vertical force", format!("{:.0} N {side}", self.size.abs()))
            }
        };
        let when = if self.still { "holding still" } else { "moving" };
        write!(
            f,
            "the model no longer explains this worker's data: while {when}, the {signal} lies in the median {size} what \
             is predicted, {:.1} times its sigma",
            self.times_sigma
        )?;
        if let Some(limb) = self.limb {
            write!(f, "; it goes with the pose of the {limb}")?;
        }
        write!(f, "; record some minutes and run `equipoise reconcile` on them")
    }
}

/// One sample in the window.
#[derive(Debug, Clone, Copy)]
struct Seen {
    time_ns: u64,
    still: bool,
    /// Measured minus predicted, in the order of the signals, and 1-σ of each.
    off: [f64; 3],
    sigma: [f64; 3],
    pose: pose::Features,
}

const SIGNALS: [Signal; 3] = [Signal::CopForward, Signal::CopLeft, Signal::Force];

/// The watch.
#[derive(Debug, Default)]
pub struct ModelWatch {
    seen: VecDeque<Seen>,
    reported_ns: Option<u64>,
    now: Option<Suspicion>,
}

impl ModelWatch {
    /// Ingests a state; returns a discrepancy to report, at most once in five minutes.
    pub fn look(&mut self, state: &State) -> Option<Suspicion> {
        if state.phase != Phase::Monitoring as u32 {
            // The subject or its identification may have changed, or a sensor is silent.
            self.seen.clear();
            self.now = None;
            return None;
        }
        let seen = Seen::of(state)?;
        if self.seen.back().is_some_and(|last| seen.time_ns <= last.time_ns) {
            return None;
        }
        self.seen.push_back(seen);
        self.seen.retain(|other| seen.time_ns - other.time_ns < WINDOW_NS);
        let first_ns = self.seen.front().map_or(seen.time_ns, |first| first.time_ns);
        if seen.time_ns - first_ns < SEEN_NS {
            return None;
        }
        self.now = self.judge();
        let silent =
            self.reported_ns.is_some_and(|reported_ns| seen.time_ns.saturating_sub(reported_ns) < SILENCE_NS);
        let reported = self.now.filter(|_| !silent)?;
        self.reported_ns = Some(seen.time_ns);
        Some(reported)
    }

    /// The current discrepancy, reported or not.
    pub fn suspected(&self) -> Option<Suspicion> {
        self.now
    }

    /// The signal with the largest discrepancy above the limit.
    fn judge(&self) -> Option<Suspicion> {
        let kinds = [true, false].into_iter().flat_map(|still| (0..3).map(move |signal| (still, signal)));
        kinds
            .filter_map(|(still, signal)| self.judge_one(still, signal))
            .max_by(|a, b| a.times_sigma.total_cmp(&b.times_sigma))
    }

    fn judge_one(&self, still: bool, signal: usize) -> Option<Suspicion> {
        let moments: Vec<&Seen> = self.seen.iter().filter(|seen| seen.still == still).collect();
        if moments.len() < MOMENTS_MIN {
            return None;
        }
        let times_sigma =
            median(moments.iter().map(|seen| (seen.off[signal] / seen.sigma[signal]).abs()).collect());
        if times_sigma <= MEDIAN_MAX {
            return None;
        }
        let off: Vec<f64> = moments.iter().map(|seen| seen.off[signal]).collect();
        let poses: Vec<pose::Features> = moments.iter().map(|seen| seen.pose).collect();
        let limb = pose::limb_that_goes_with(&off, &poses);
        Some(Suspicion { signal: SIGNALS[signal], still, size: median(off), times_sigma, limb })
    }
}

impl Seen {
    /// `None` with a load, or if a quantity is unavailable.
    fn of(state: &State) -> Option<Seen> {
        let valid = state.validity();
        if !valid.any_of(Validity::BELOW_LOAD_THRESHOLD) || valid.any_of(Validity::SPOILS_RESIDUAL) {
            return None;
        }
        let cop = |axis: usize| state.cop_measured_m[axis] - state.cop_estimated_m[axis];
        let cop_sigma = |axis: usize| state.cop_sigma_m[axis].hypot(state.cop_measured_sigma_m[axis]);
        let seen = Seen {
            time_ns: state.suit_sample_time_ns,
            still: state.static_pose == 1,
            off: [cop(0), cop(1), state.delta_f_n[2]],
            sigma: [cop_sigma(0), cop_sigma(1), state.delta_f_sigma_n],
            pose: pose::features(|segment: Segment| state.segment_origin_m[segment.index()]),
        };
        seen.sigma.iter().all(|sigma| *sigma > 0.0).then_some(seen)
    }
}

/// The median; 0 if empty.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
