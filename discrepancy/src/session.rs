//! A session: the data of one recording of one subject.

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
    /// Prior covariance of the chain's parameters (all 69, segment by segment) before any pose, m², row by row. The
    /// blocks' `phi_m` holds the identified parameters.
    pub prior_covariance_m2: Vec<f64>,
    /// Whether horizontal forces were measured.
    pub has_shear: bool,
    /// Whether the model includes the body's inertia.
    pub has_inertia: bool,
    /// Whether the suit's position drifts, so that the anchor holds the feet and each stance has its own offset.
    pub suit_drifts: bool,
    /// Length of a block, s.
    pub block_s: f64,
    /// Phases of the recording, s since its start; `None` where there is none.
    pub spans_s: Spans,
    /// Length of the recording, s.
    pub length_s: f64,
}

/// Phases of a recording, s since its start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spans {
    /// Identification poses.
    pub identify: [f64; 2],
    /// Work declared clean.
    pub reference: Option<[f64; 2]>,
    /// Work in question.
    pub work: [f64; 2],
    /// Whether they were determined from the recording rather than given.
    pub found: bool,
}
