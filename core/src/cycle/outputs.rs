//! Outputs of the stages for one instant.

use super::cop_estimate::Estimate;
use super::differentiate::Instant;
use super::ground::Ground;
use super::loading::Overload;
use super::prediction::Prediction;
use super::stillness::Stillness;
use super::validity::Withheld;

/// Outputs up to the validity flags.
#[derive(Clone, Copy)]
pub(super) struct Outputs<'a> {
    pub(super) instant: &'a Instant,
    pub(super) ground: &'a Ground,
    pub(super) stillness: &'a Stillness,
    pub(super) prediction: &'a Prediction,
    pub(super) estimate: &'a Estimate,
    /// `None` while samples of suit or ground are implausible.
    pub(super) overload: Option<&'a Overload>,
    pub(super) withheld: &'a Withheld,
}
