//! A session: the data of one recording of one subject.

use std::fmt;

use equipoise_core::anchor::LIFTED_M;
use equipoise_core::body::SEGMENTS;

use crate::block::Block;
use crate::constants::STANCE_MARGIN_S;

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
    /// Blocks of the work that are not usable.
    pub left_out: LeftOut,
}

/// Number of blocks of the work that were left out, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// A foot is in the air, or was shortly before or after.
    pub lifted_foot: usize,
    /// A foot has come down somewhere else shortly before or after.
    pub step: usize,
    /// The plate has no centre of pressure.
    pub no_cop: usize,
    /// The acceleration is that of an impact or a jump.
    pub impact: usize,
}

impl LeftOut {
    /// What to do about them; nothing if the feet are no reason.
    pub(crate) fn advice(&self) -> &'static str {
        if self.lifted_foot + self.step == 0 {
            return "";
        }
        "; if both feet stood, a sensor of a leg is displaced: fasten it, and calibrate the suit"
    }
}

impl fmt::Display for LeftOut {
    /// The reasons that occur; nothing if there are none.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lifted_cm = 100.0 * LIFTED_M;
        let lifted = format!("of a lifted foot (ankle {lifted_cm:.0} cm above the other)");
        let reasons = [
            (self.lifted_foot, format!("within {STANCE_MARGIN_S} s {lifted}")),
            (self.step, format!("within {STANCE_MARGIN_S} s of a step")),
            (self.no_cop, "without a centre of pressure".to_owned()),
            (self.impact, "with the acceleration of an impact".to_owned()),
        ];
        let mut before = "; left out: ";
        for (count, reason) in reasons.iter().filter(|(count, _)| *count > 0) {
            write!(f, "{before}{count} {reason}")?;
            before = ", ";
        }
        Ok(())
    }
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
