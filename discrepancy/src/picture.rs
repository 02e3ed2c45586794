//! Data of the report's figures: the residual over time, pose and each effect's own predictor, and the remaining
//! residual.
//!
//! All data refer to the work in question, in the units of its [`Signal`]. "Before" is measured minus predicted with
//! the original model, minus the expectation from the clean part of the recording; "after" subtracts the named effects
//! as well, with parameters fitted on *other* time intervals. If no effect was named, the two are equal. The engine
//! fills it block by block, however long the recording; the report decimates it. A value that could not be computed is
//! left out, never NaN.

use crate::block::Phase;
use crate::session::Spans;

/// Data of all figures of the report.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Phases of the recording, s since its start.
    pub spans_s: Spans,
    /// Length of the recording, s.
    pub length_s: f64,
    /// Length of a block, s.
    pub block_s: f64,
    /// Log Bayes factor from which an effect is named.
    pub threshold_log_odds: f64,
    /// The residual over time: one per signal, blocks by time.
    pub time: Vec<TimePlot>,
    /// The residual over pose features, highest correlation first.
    pub pose: Vec<PosePlot>,
    /// The residual over the prediction of each named effect; empty if none was named.
    pub predictors: Vec<PredictorPlot>,
    /// Whiteness of the remaining residual, one per signal.
    pub whiteness: Vec<Whiteness>,
    /// Normalised innovations: histogram of the squared whitened residual.
    pub surprise: Vec<SurpriseBin>,
    /// The few windows of the work with the largest residual over noise after the change, worst first.
    pub windows: Vec<Window>,
    /// Gap by phase and signal.
    pub phases: Vec<PhaseGap>,
    /// Upper bounds of undetected effects; reported if none was named.
    pub unseen: Vec<Unseen>,
}

/// A measured signal that the model predicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Signal {
    /// Centre of pressure forward, mm.
    CopX,
    /// Centre of pressure to the left, mm.
    CopY,
    /// Vertical force, N.
    Fz,
}

impl Signal {
    /// All, in the order of the report.
    pub const ALL: [Signal; 3] = [Signal::CopX, Signal::CopY, Signal::Fz];

    /// Name as in [`crate::finding::Suspicion::signal`].
    pub const fn name(self) -> &'static str {
        match self {
            Signal::CopX => "cop_x",
            Signal::CopY => "cop_y",
            Signal::Fz => "fz",
        }
    }

    /// Name as in [`crate::finding::Gap::per_axis`].
    pub const fn axis(self) -> &'static str {
        match self {
            Signal::CopX => "x",
            Signal::CopY => "y",
            Signal::Fz => "fz",
        }
    }

    /// Unit of its values.
    pub const fn unit(self) -> &'static str {
        match self {
            Signal::CopX | Signal::CopY => "mm",
            Signal::Fz => "N",
        }
    }
}

/// The residual of one signal over time.
#[derive(Debug, Clone, PartialEq)]
pub struct TimePlot {
    /// The signal; its unit is that of the values.
    pub signal: Signal,
    /// Blocks by time.
    pub points: Vec<TimePoint>,
}

/// One block of a [`TimePlot`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimePoint {
    /// Middle of the block, s since the recording's start.
    pub time_s: f64,
    /// Whether it is a static pose.
    pub still: bool,
    /// Residual before.
    pub before: f64,
    /// Residual after, by parameters from other blocks.
    pub after: f64,
    /// 1-σ of noise alone here, coloured noise included.
    pub noise_sigma: f64,
}

/// The residual of one signal against one feature of the pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PosePlot {
    /// The signal.
    pub signal: Signal,
    /// The feature in words: "trunk inclination", "right arm elevation".
    pub feature: String,
    /// Its unit: `°`, `m`.
    pub unit: &'static str,
    /// One per block, in any order.
    pub points: Vec<PosePoint>,
    /// Root mean square of noise alone.
    pub noise_sigma: f64,
}

/// One block of a [`PosePlot`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosePoint {
    /// Value of the feature.
    pub feature: f64,
    /// Residual before.
    pub before: f64,
    /// Residual after.
    pub after: f64,
}

/// The residual of one signal over the prediction of one named effect: on the diagonal if the effect is correct.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictorPlot {
    /// Name with place, as in [`crate::finding::Candidate::name`].
    pub effect: String,
    /// The signal that the effect changes most.
    pub signal: Signal,
    /// One per block in which the effect acts, in any order.
    pub points: Vec<PredictorPoint>,
    /// Root mean square of noise alone.
    pub noise_sigma: f64,
}

/// One block of a [`PredictorPlot`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictorPoint {
    /// Column times value, with parameters from other blocks.
    pub predicted: f64,
    /// Residual after subtraction of the other named effects, but not of this one.
    pub residual: f64,
}

/// Whether the remaining residual of one signal is white once its modelled colour is removed.
#[derive(Debug, Clone, PartialEq)]
pub struct Whiteness {
    /// The signal.
    pub signal: Signal,
    /// Autocorrelation of the whitened residual before, from a lag of one block on.
    pub before: Vec<f64>,
    /// The same after.
    pub after: Vec<f64>,
    /// 95 of 100 lags of white noise are within plus and minus this.
    pub bound: f64,
}

/// One bin of the histogram of the squared whitened residual, per block and signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurpriseBin {
    /// Lower bound.
    pub from: f64,
    /// Upper bound; that of the last bin may be infinite.
    pub to: f64,
    /// Fraction of blocks before, in \[0, 1\].
    pub before: f64,
    /// Fraction of blocks after.
    pub after: f64,
    /// Fraction expected by noise alone.
    pub expected: f64,
}

/// An interval of the work and its ratio of residual to noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Start, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Signal with the largest ratio.
    pub signal: Signal,
    /// Root mean square of the whitened residual there, before: 1 is noise alone.
    pub times_noise_before: f64,
    /// The same after.
    pub times_noise_after: f64,
}

/// Gap of one signal in one phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseGap {
    /// The phase.
    pub phase: Phase,
    /// The signal.
    pub signal: Signal,
    /// Root mean square before.
    pub before: f64,
    /// Root mean square after, held out.
    pub after: f64,
    /// Root mean square of noise alone.
    pub noise_floor: f64,
}

/// Upper bound of an effect that was tested and not detected.
#[derive(Debug, Clone, PartialEq)]
pub struct Unseen {
    /// Name with place.
    pub effect: String,
    /// Parameter's name.
    pub parameter: String,
    /// 95 % upper bound of its size.
    pub at_most: f64,
    /// Unit.
    pub unit: &'static str,
}
