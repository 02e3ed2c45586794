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
use equipoise_core::message::{Incident, State, Validity};
use equipoise_core::time::NS_PER_S;

use crate::incidents::IncidentBoard;
use crate::status_file::StatusFile;

mod pose;

use pose::Limb;

/// Length of the window, ns.
const WINDOW_NS: u64 = 60 * NS_PER_S;
/// Minimum time span in the window for an evaluation, ns.
const SPAN_MIN_NS: u64 = 40 * NS_PER_S;
/// Minimum number of samples of one kind for an evaluation.
const SAMPLES_MIN: usize = 15;
/// Median of the residual's magnitude over σ above which the model is rejected. A Gaussian has 0.67; the limit of 3
/// tolerates a σ that is wrong by a factor of four.
const MEDIAN_MAX: f64 = 3.0;
/// Minimum interval between reports, ns.
const REPORT_INTERVAL_NS: u64 = 300 * NS_PER_S;

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
    pub is_static: bool,
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
        let when = if self.is_static { "holding still" } else { "moving" };
        write!(
            f,
            "the model no longer explains this worker's data: while {when}, the {signal} lies in the median {size} what \
             is predicted, {:.1} times its sigma",
            self.times_sigma
        )?;
        if let Some(limb) = self.limb {
            write!(f, "; it goes with the pose of the {limb}")?;
        }
        write!(
            f,
            "; {}; if it persists, record some minutes and run `equipoise reconcile` on them",
            self.advice()
        )
    }
}

impl Suspicion {
    /// The likely causes and their remedies.
    fn advice(&self) -> &'static str {
        match (self.signal, self.limb) {
            (Signal::Force, _) if self.size < 0.0 => {
                "likely causes: a foot or hand that is supported next to the plate (stand free), a changed zero or gain \
                 of the plate (tare it while it is empty, then identify the worker again)"
            }
            (Signal::Force, _) => {
                "likely causes: a light load or clothing (put it down, or identify the worker again with it), a changed \
                 zero or gain of the plate (tare it while it is empty, then identify the worker again)"
            }
            (_, Some(_)) => {
                "likely causes: a sensor that slipped there (calibrate the suit), a light load or clothing there (put \
                 it down, or identify the worker again with it)"
            }
            (_, None) => {
                "likely causes: the suit drifted (restart it: its position is then estimated again), the plate was moved \
                 (register it again), other clothing or another worker (identify again)"
            }
        }
    }
}

/// One sample in the window.
#[derive(Debug, Clone, Copy)]
struct ResidualSample {
    time_ns: u64,
    is_static: bool,
    /// Measured minus predicted, in the order of the signals, and 1-σ of each.
    residual: [f64; 3],
    sigma: [f64; 3],
    pose: pose::Features,
}

const SIGNALS: [Signal; 3] = [Signal::CopForward, Signal::CopLeft, Signal::Force];

/// The watch.
#[derive(Debug, Default)]
pub struct ModelWatch {
    samples: VecDeque<ResidualSample>,
    reported_ns: Option<u64>,
    current: Option<Suspicion>,
}

impl ModelWatch {
    /// Ingests a state and sets incident and status to the current discrepancy. Returns whether it is to be reported, at
    /// most once in five minutes.
    pub fn check(&mut self, state: &State, board: &IncidentBoard, status: &StatusFile) -> bool {
        let is_reported = self.update(state).is_some();
        let suspicion = self.current.map(|suspicion| suspicion.to_string());
        board.set(Incident::ModelMismatch, suspicion.is_some(), || suspicion.clone().unwrap_or_default());
        status.set_model_mismatch(suspicion);
        is_reported
    }

    /// Ingests a state; returns a discrepancy to report, at most once in five minutes.
    fn update(&mut self, state: &State) -> Option<Suspicion> {
        // With a changed model the residuals are those of another subject, model or tare.
        let phase =
            Phase::from_number(state.phase).filter(|_| !state.validity().any_of(Validity::MODEL_CHANGED));
        match phase {
            Some(Phase::Monitoring) => {}
            // A sensor is silent; subject and identification stay.
            Some(Phase::Degraded) => return None,
            _ => {
                self.samples.clear();
                self.current = None;
                return None;
            }
        }
        let sample = ResidualSample::of(state)?;
        if self.samples.back().is_some_and(|last| sample.time_ns <= last.time_ns) {
            return None;
        }
        self.samples.push_back(sample);
        self.samples.retain(|other| sample.time_ns - other.time_ns < WINDOW_NS);
        let first_ns = self.samples.front().map_or(sample.time_ns, |first| first.time_ns);
        if sample.time_ns - first_ns < SPAN_MIN_NS {
            self.current = None;
            return None;
        }
        self.current = self.evaluate();
        let recently_reported = self
            .reported_ns
            .is_some_and(|reported_ns| sample.time_ns.saturating_sub(reported_ns) < REPORT_INTERVAL_NS);
        let reported = self.current.filter(|_| !recently_reported)?;
        self.reported_ns = Some(sample.time_ns);
        Some(reported)
    }

    /// The signal with the largest discrepancy above the limit.
    fn evaluate(&self) -> Option<Suspicion> {
        let kinds =
            [true, false].into_iter().flat_map(|is_static| (0..3).map(move |signal| (is_static, signal)));
        kinds
            .filter_map(|(is_static, signal)| self.evaluate_signal(is_static, signal))
            .max_by(|a, b| a.times_sigma.total_cmp(&b.times_sigma))
    }

    fn evaluate_signal(&self, is_static: bool, signal: usize) -> Option<Suspicion> {
        let selected: Vec<&ResidualSample> =
            self.samples.iter().filter(|sample| sample.is_static == is_static).collect();
        if selected.len() < SAMPLES_MIN {
            return None;
        }
        let times_sigma = median(
            selected.iter().map(|sample| (sample.residual[signal] / sample.sigma[signal]).abs()).collect(),
        );
        if times_sigma <= MEDIAN_MAX {
            return None;
        }
        let residual: Vec<f64> = selected.iter().map(|sample| sample.residual[signal]).collect();
        let poses: Vec<pose::Features> = selected.iter().map(|sample| sample.pose).collect();
        let limb = pose::correlated_limb(&residual, &poses);
        Some(Suspicion { signal: SIGNALS[signal], is_static, size: median(residual), times_sigma, limb })
    }
}

impl ResidualSample {
    /// `None` with a load, or if a quantity is unavailable.
    fn of(state: &State) -> Option<ResidualSample> {
        let valid = state.validity();
        if !valid.any_of(Validity::BELOW_LOAD_THRESHOLD) || valid.any_of(Validity::INVALIDATES_RESIDUAL) {
            return None;
        }
        let cop = |axis: usize| state.cop_measured_m[axis] - state.cop_estimated_m[axis];
        let cop_sigma = |axis: usize| state.cop_sigma_m[axis].hypot(state.cop_measured_sigma_m[axis]);
        let sample = ResidualSample {
            time_ns: state.suit_sample_time_ns,
            is_static: state.static_pose == 1,
            residual: [cop(0), cop(1), state.delta_f_n[2]],
            sigma: [cop_sigma(0), cop_sigma(1), state.delta_f_sigma_n],
            pose: pose::features(|segment: Segment| state.segment_origin_m[segment.index()]),
        };
        sample.sigma.iter().all(|sigma| *sigma > 0.0).then_some(sample)
    }
}

/// The median; 0 if empty.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
