//! A fraction of a second of a session: means of what was predicted and measured.

use equipoise_core::body::SEGMENTS;
use equipoise_core::effect::Observation;

/// Lags for which each block keeps what they would change, s: negative where the suit is early.
pub const LAGS_S: [f64; 13] =
    [-0.12, -0.08, -0.05, -0.03, -0.02, -0.01, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.18];
/// Cutoffs of a first-order filter for which each block keeps what it would change, Hz.
pub const CUTOFFS_HZ: [f64; 8] = [0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 4.5, 7.0];

/// What a change in time would change of the prediction: centre of pressure, m, and force, N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Of the centre of pressure, m.
    pub cop_m: [f64; 2],
    /// Of the force, N.
    pub force_n: [f64; 3],
}

/// What a block belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Poses from which the worker was identified.
    Identify,
    /// Work that is known to be clean.
    Reference,
    /// Work in question.
    Work,
}

/// Means over a block of suit samples. Everything that was differentiated went through one and the same smoothing as
/// the ground's signals, so filters do not look like effects.
#[derive(Debug, Clone)]
pub struct Block {
    /// Where it belongs.
    pub phase: Phase,
    /// Number of the stance: the feet have not moved within one.
    pub stance: u64,
    /// Whether all of it is a held pose.
    pub still: bool,
    /// Means of everything that effects are made of; `time_s` is that of the suit samples in it, s since the recording's begin.
    pub observation: Observation,
    /// Velocity of the centre of mass, m/s.
    pub com_velocity_m_per_s: [f64; 3],
    /// Shift of the centre of pressure by the turning of trunk, right arm, left arm, legs (sum: `turning_m`), m.
    pub turning_by_group_m: [[f64; 2]; 4],
    /// Rotation vector of each segment against its parent (pelvis: against the feet's heading), rad.
    pub joint_rad: [[f64; 3]; SEGMENTS],
    /// Heading of the standing feet, rad.
    pub heading_rad: f64,
    /// What each of [`LAGS_S`] would change.
    pub by_lag: [Change; LAGS_S.len()],
    /// What each of [`CUTOFFS_HZ`] would change.
    pub by_cutoff: [Change; CUTOFFS_HZ.len()],
}
