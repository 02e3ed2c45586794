//! Plausibility checks beyond a good fit: minimum size, a mass at a plausible place, evidence from more than one
//! channel.

use equipoise_core::body::Segment;
use equipoise_core::effect::{Effect, Place};

use crate::candidate::{Candidate, Scope};
use crate::constants::{
    ARMS_MAX, CLEAR_LEAD, FILTER_FACTOR_MIN, IMPLAUSIBLE, IN_PART, LEG_ROTATION_BY_FORCES,
    LEG_ROTATION_MIN_RAD, OFFSET_BY_STANCES, ORIENTATION, ROTATION_BY_COP,
};
use crate::evidence::log_odds;
use crate::gram::Gram;
use crate::linear::dot;

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

/// Reason to reject an explanation by its parameters, if there is one.
pub(crate) fn implausibility(candidate: &Candidate, value: &[f64]) -> Option<String> {
    if is_negligible(candidate, value) {
        return Some("below the negligible size".to_owned());
    }
    let prior_sigma = candidate.effect.prior_sigma(candidate.place, candidate.shape);
    let [of_any, of_heading, of_drift] = IMPLAUSIBLE;
    let implausible = match candidate.effect {
        Effect::PlateDrift => of_drift,
        Effect::SegmentHeading => of_heading,
        _ => of_any,
    };
    if !candidate.is_shape_factor()
        && value.iter().zip(prior_sigma).any(|(value, sigma)| value.abs() > implausible * sigma)
    {
        return Some("implausibly large".to_owned());
    }
    match candidate.effect {
        Effect::HandLoad if value[0] < 0.0 => return Some("the mass is negative".to_owned()),
        Effect::PlateLowpass if value[0] < FILTER_FACTOR_MIN => {
            return Some("the filter is reversed".to_owned());
        }
        _ => {}
    }
    let arm_m = candidate.effect.arm_sigma_m(candidate.place)?;
    let moment_kg_m = value.iter().skip(1).map(|moment| moment * moment).sum::<f64>().sqrt();
    (moment_kg_m > ARMS_MAX * arm_m * value[0].abs() && value.len() > 1)
        .then(|| "the mass is outside its place".to_owned())
}

/// Whether only the forces support a term: then it is neither a mass nor a rotated segment.
pub(crate) fn is_by_forces_only(gram: &Gram<'_>, accepted: &[usize], term: usize, log_odds: f64) -> bool {
    let Some(candidate) = &gram.terms[term].candidate else { return false };
    // Segments that carry the whole body act on the forces, and the stance offset masks their effect on the pressure.
    if is_leg_rotation(candidate) && log_odds > LEG_ROTATION_BY_FORCES {
        return false;
    }
    // For masses the alternative is a gain of the force, and the odds decide (`is_no_better_than_gain`).
    let is_exempt = matches!(candidate.effect, Effect::ForceGain | Effect::WornMass | Effect::HandLoad);
    let min = if is_rotation(candidate) { ROTATION_BY_COP } else { CLEAR_LEAD };
    !is_exempt && log_odds_by_cop(gram, accepted, term) < min
}

/// Reason why the evidence is insufficient for this kind of effect, if it is.
pub(crate) fn insufficient_evidence(gram: &Gram<'_>, term: usize, log_odds: f64) -> Option<String> {
    let candidate = gram.terms[term].candidate.as_ref()?;
    let in_part = matches!(candidate.scope, Scope::Span(_));
    let [timing, plate] = IN_PART;
    let (min, why) = match candidate.effect {
        Effect::PlateOffset if candidate.scope == Scope::All && gram.rows.session.suit_drifts => {
            (OFFSET_BY_STANCES, "stance offsets explain the same")
        }
        Effect::SegmentHeading | Effect::SegmentMisalignment => {
            (ORIENTATION, "misalignment and slip of the sensors explain the same")
        }
        Effect::SuitLag | Effect::PlateLowpass if in_part => {
            (timing, "lags and filters rarely change for a part of the work")
        }
        Effect::PlateGain | Effect::PlateCrosstalk | Effect::PlateHeight | Effect::PlateYaw if in_part => {
            (plate, "plate errors rarely change for a part of the work")
        }
        _ => return None,
    };
    (log_odds < min).then(|| why.to_owned())
}

/// Whether a mass explains no more than a gain of the vertical force would: its weight alone does not determine its
/// place.
pub(crate) fn is_no_better_than_gain(gram: &Gram<'_>, accepted: &[usize], term: usize) -> bool {
    let Some(candidate) = &gram.terms[term].candidate else { return false };
    if !matches!(candidate.effect, Effect::WornMass | Effect::HandLoad) {
        return false;
    }
    let rival = Candidate::new(Effect::ForceGain, Place::Whole, 0.0, candidate.scope);
    let (directions, residual) = gram.directions_given(accepted);
    let own = gram.score_candidate(candidate, &directions, &residual);
    gram.score_candidate(&rival, &directions, &residual) > own - CLEAR_LEAD
}

/// Log Bayes factor of a term from the rows of the centre of pressure alone.
pub(crate) fn log_odds_by_cop(gram: &Gram<'_>, accepted: &[usize], term: usize) -> f64 {
    let rows = gram.cop_rows();
    let odds = |terms: &[usize]| {
        let columns = gram.columns_of(terms);
        let (mean, sigma) = gram.priors(terms);
        let part = |column: usize| &gram.columns[columns[column]][..rows];
        log_odds(&|i, j| dot(part(i), part(j)), &|i| dot(part(i), &gram.residual[..rows]), &mean, &sigma)
    };
    let with: Vec<usize> = accepted.iter().copied().chain([term]).collect();
    odds(&with) - odds(accepted)
}
