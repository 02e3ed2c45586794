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

/// All that the report draws.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Phases of the recording, s since its start.
    pub spans_s: Spans,
    /// How long the recording is, s.
    pub length_s: f64,
    /// How long a block is, s.
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
    /// Normalised innovations: how often the whitened residual is how large.
    pub surprise: Vec<SurpriseBin>,
    /// Windows of the work by how far they are beyond noise after the change, worst first; a handful.
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
    /// Which signal; its unit is that of the values.
    pub signal: Signal,
    /// Blocks by time.
    pub points: Vec<TimePoint>,
}

/// One block of a [`TimePlot`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimePoint {
    /// Middle of the block, s since the recording's begin.
    pub time_s: f64,
    /// Whether it is a held pose.
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
    /// Which signal.
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
    /// One per block in which the effect holds, in any order.
    pub points: Vec<PredictorPoint>,
    /// Root mean square of noise alone.
    pub noise_sigma: f64,
}

/// One block of a [`PredictorPlot`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictorPoint {
    /// Column times value, with parameters from other blocks.
    pub predicted: f64,
    /// Residual with the other named effects taken off, but not this one.
    pub residual: f64,
}

/// Whether the remaining residual of one signal is white once its modelled colour is removed.
#[derive(Debug, Clone, PartialEq)]
pub struct Whiteness {
    /// Which signal.
    pub signal: Signal,
    /// Autocorrelation of the whitened residual before, from a lag of one block on.
    pub before: Vec<f64>,
    /// The same after.
    pub after: Vec<f64>,
    /// White noise stays within plus and minus this in 95 of 100 lags.
    pub bound: f64,
}

/// How often the whitened residual squared, per block and signal, is this large.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurpriseBin {
    /// Begin and end; the end of the last may be infinite.
    pub from: f64,
    /// End.
    pub to: f64,
    /// Share of blocks before, in \[0, 1\].
    pub before: f64,
    /// Share of blocks after.
    pub after: f64,
    /// Share that noise alone would have.
    pub expected: f64,
}

/// A stretch of the work and how far it is beyond noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Begin, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Signal that shows it most.
    pub signal: Signal,
    /// Root mean square of the whitened residual there, before: 1 is noise alone.
    pub times_noise_before: f64,
    /// The same after.
    pub times_noise_after: f64,
}

/// Gap of one signal in one phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseGap {
    /// Which phase.
    pub phase: Phase,
    /// Which signal.
    pub signal: Signal,
    /// Root mean square before.
    pub before: f64,
    /// After, held out.
    pub after: f64,
    /// By noise alone.
    pub noise_floor: f64,
}

/// An effect that was looked for and is smaller than this, if it is there.
#[derive(Debug, Clone, PartialEq)]
pub struct Unseen {
    /// Name with place.
    pub effect: String,
    /// Parameter's name.
    pub parameter: String,
    /// Largest size that these data allow with 95 %.
    pub at_most: f64,
    /// Unit.
    pub unit: &'static str,
}
