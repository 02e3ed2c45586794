//! A session: what one recording shows of one worker.

use equipoise_core::body::SEGMENTS;

use crate::block::Block;

/// Number of the chain's parameters.
pub const PARAMETERS: usize = 3 * SEGMENTS;

/// A recording, compared with the model.
#[derive(Debug, Clone)]
pub struct Session {
    /// All usable blocks by time.
    pub blocks: Vec<Block>,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// What was believed of the chain's parameters (all 69, segment by segment) before any pose: covariance, m², row by
    /// row. The blocks' `phi_m` is what was identified.
    pub prior_covariance_m2: Vec<f64>,
    /// Whether horizontal forces were measured.
    pub has_shear: bool,
    /// Whether the model takes the body's inertia into account.
    pub has_inertia: bool,
    /// Whether the suit's position drifts, so that the feet are held and each stance has an offset of its own.
    pub suit_drifts: bool,
    /// How long a block is, s.
    pub block_s: f64,
    /// Begin and end of the phases that were taken, s since the recording's begin; `None` where there is none.
    pub spans_s: Spans,
    /// How long the recording is, s.
    pub length_s: f64,
}

/// Which part of a recording is what, s since its begin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spans {
    /// Identification poses.
    pub identify: [f64; 2],
    /// Work known to be clean.
    pub reference: Option<[f64; 2]>,
    /// Work in question.
    pub work: [f64; 2],
    /// Whether they were found and not given.
    pub found: bool,
}
