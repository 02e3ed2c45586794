//! Physical impossibilities of an effect's parameters, and sizes too small to be reported.

use equipoise_config::model_file::largest;
use equipoise_core::body::Segment;
use equipoise_core::effect::{Effect, Place};

use crate::candidate::Candidate;
use crate::constants::{ARMS_MAX, FILTER_FACTOR_MIN, LEG_ROTATION_MIN_RAD};

/// Whether it is a rotation of one segment.
fn is_rotation(candidate: &Candidate) -> bool {
    matches!(candidate.effect, Effect::SegmentHeading | Effect::SegmentMisalignment)
}

/// Whether it is a rotation of the pelvis or of a leg.
fn is_leg_rotation(candidate: &Candidate) -> bool {
    is_rotation(candidate)
        && matches!(candidate.place, Place::Segment(segment) if !segment.is_distal_to(Segment::L5))
}

/// Whether an effect with these parameters is negligible.
pub(crate) fn is_negligible(candidate: &Candidate, value: &[f64]) -> bool {
    let min = if is_leg_rotation(candidate) {
        LEG_ROTATION_MIN_RAD
    } else {
        candidate.effect.smallest_of_interest()
    };
    candidate.size(value) < min
}

/// Why an effect cannot have these parameters, if it cannot.
pub(crate) fn impossibility(candidate: &Candidate, value: &[f64]) -> Option<&'static str> {
    match candidate.effect {
        Effect::HandLoad if value[0] < 0.0 => return Some("the mass is negative"),
        Effect::PlateLowpass if value[0] < FILTER_FACTOR_MIN => return Some("the filter is reversed"),
        _ => {}
    }
    let declared = candidate.effect.parameters_of(candidate.shape);
    let is_too_large = |(value, unit): (&f64, &str)| value.abs() > largest(unit);
    if !candidate.is_shape_factor() && value.iter().zip(declared.iter().map(|one| one.unit)).any(is_too_large)
    {
        return Some("a parameter is larger than any that a model file may have");
    }
    let arm_m = candidate.effect.arm_sigma_m(candidate.place)?;
    let moment_kg_m = value.iter().skip(1).map(|moment| moment * moment).sum::<f64>().sqrt();
    (moment_kg_m > ARMS_MAX * arm_m * value[0].abs() && value.len() > 1)
        .then_some("the mass is outside its place")
}
