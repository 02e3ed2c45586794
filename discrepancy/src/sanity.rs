//! Plausibility checks beyond a good fit: minimum size, a mass at a plausible place, evidence from more than one
//! channel.

use equipoise_core::body::Segment;
use equipoise_core::effect::{Effect, PARAMETERS_MAX, Place};

use crate::candidate::{Candidate, Scope};
use crate::evidence::log_odds;
use crate::gram::Gram;

/// Minimum evidence by the centre of pressure alone for a term that acts on forces and centre of pressure, log odds.
const FROM_COP_ALONE: f64 = 3.0;
/// Threshold for a turned segment: fast segments have the largest orientation errors, and poses show a turn as well.
const TURN_FROM_COP_ALONE: f64 = 8.0;
/// From this evidence on, a turn below the trunk requires no support by the centre of pressure, log odds.
const BELOW_BY_FORCES: f64 = 35.0;
/// Estimates beyond this many prior σ are rejected.
const ABSURD: f64 = 4.5;
/// The same for a drift and for a heading near iron, which may be of any size.
const ABSURD_DRIFT: f64 = 20.0;
const ABSURD_HEADING: f64 = 9.0;
/// Largest first moment as a multiple of the prior arm length.
const ARMS: f64 = 2.5;
/// The factor of a lag or filter is near one if the shape is right.
const LEAST_SHARE: f64 = 0.3;

/// Errors of pelvis and legs add up where the feet hold the body, and soft tissue rotates them by degrees: smaller
/// rotations than this are not caused by iron, rad.
const LEAST_BELOW_RAD: f64 = 8.0 * std::f64::consts::PI / 180.0;

/// The size of an effect with these parameters ([`Effect::size`]).
pub(crate) fn size(candidate: &Candidate, value: &[f64]) -> f64 {
    let parameters = candidate.parameters(value);
    candidate.effect.size(candidate.reported_shape(value), &parameters)
}

/// Whether it is a rotation of the pelvis or of a leg.
fn is_turned_below(candidate: &Candidate) -> bool {
    let is_turn = matches!(candidate.effect, Effect::SegmentHeading | Effect::SegmentMisalignment);
    is_turn && matches!(candidate.place, Place::Segment(segment) if !segment.is_distal_to(Segment::L5))
}

/// Whether an effect with these parameters is negligible.
pub(crate) fn is_too_small(candidate: &Candidate, value: &[f64]) -> bool {
    let least =
        if is_turned_below(candidate) { LEAST_BELOW_RAD } else { candidate.effect.smallest_of_interest() };
    size(candidate, value) < least
}

/// Reason to reject an explanation, if there is one.
pub(crate) fn objection(candidate: &Candidate, value: &[f64]) -> Option<String> {
    if is_too_small(candidate, value) {
        return Some("smaller than what matters".to_owned());
    }
    let believed = candidate.effect.prior_sigma(candidate.place, candidate.shape);
    let absurd = match candidate.effect {
        Effect::PlateDrift => ABSURD_DRIFT,
        Effect::SegmentHeading => ABSURD_HEADING,
        _ => ABSURD,
    };
    if !candidate.is_a_share()
        && value.iter().zip(believed).any(|(value, sigma)| value.abs() > absurd * sigma)
    {
        return Some("would have to be absurdly large".to_owned());
    }
    match candidate.effect {
        Effect::HandLoad if value[0] < 0.0 => return Some("a mass would have to be negative".to_owned()),
        Effect::PlateLowpass if value[0] < LEAST_SHARE => {
            return Some("would have to be a filter the other way round".to_owned());
        }
        _ => {}
    }
    let arm_m = candidate.effect.arm_sigma_m(candidate.place)?;
    let moment_kg_m = value.iter().skip(1).map(|moment| moment * moment).sum::<f64>().sqrt();
    (moment_kg_m > ARMS * arm_m * value[0].abs() && value.len() > 1)
        .then(|| "the mass would not be where it is worn".to_owned())
}

/// Whether only the forces support a term: then it is neither a mass nor a turned segment.
pub(crate) fn only_by_forces(gram: &Gram<'_>, accepted: &[usize], term: usize, log_odds: f64) -> bool {
    let Some(candidate) = &gram.terms[term].candidate else { return false };
    // Segments that carry the whole body act on the forces, and the stance offset masks their effect on the pressure.
    if is_turned_below(candidate) && log_odds > BELOW_BY_FORCES {
        return false;
    }
    // For masses the alternative is a gain of the force, and the odds decide (`no_better_than_a_gain`).
    let is_judged_otherwise =
        matches!(candidate.effect, Effect::ForceGain | Effect::WornMass | Effect::HandLoad);
    let is_turn = matches!(candidate.effect, Effect::SegmentHeading | Effect::SegmentMisalignment);
    let least = if is_turn { TURN_FROM_COP_ALONE } else { FROM_COP_ALONE };
    !is_judged_otherwise && from_cop_alone(gram, accepted, term) < least
}

/// Evidence required beyond the threshold, in log odds. An offset present from the start shows only in the stance
/// offsets, which vary by centimetres.
const OFFSET_BY_STANCES: f64 = 35.0;
/// Orientations: the noise model covers soft tissue and drift only in part.
const TURN: f64 = 22.0;
/// A lag or filter error in a part of the work only.
const TIMING_IN_PART: f64 = 40.0;
/// A plate whose axes change temporarily.
const PLATE_IN_PART: f64 = 25.0;

/// Reason why the evidence is insufficient here.
pub(crate) fn unproven(gram: &Gram<'_>, term: usize, log_odds: f64) -> Option<String> {
    let candidate = gram.terms[term].candidate.as_ref()?;
    let in_part = matches!(candidate.scope, Scope::Span(_));
    let (least, why) = match candidate.effect {
        Effect::PlateOffset if candidate.scope == Scope::All && gram.rows.session.suit_drifts => {
            (OFFSET_BY_STANCES, "may as well be where the feet were put down")
        }
        Effect::SegmentHeading | Effect::SegmentMisalignment => {
            (TURN, "may as well be how the sensors sit and slip")
        }
        Effect::SuitLag | Effect::PlateLowpass if in_part => {
            (TIMING_IN_PART, "clocks and filters hardly change for a while")
        }
        Effect::PlateGain | Effect::PlateCrosstalk | Effect::PlateHeight | Effect::PlateYaw if in_part => {
            (PLATE_IN_PART, "a plate hardly changes for a while")
        }
        _ => return None,
    };
    (log_odds < least).then(|| why.to_owned())
}

/// Required lead of a mass over a gain of the vertical force, in log odds: its weight alone does not determine its
/// place.
const OVER_A_GAIN: f64 = 3.0;

/// Whether a mass explains no more than a gain of the vertical force would.
pub(crate) fn no_better_than_a_gain(gram: &Gram<'_>, accepted: &[usize], term: usize) -> bool {
    let Some(candidate) = &gram.terms[term].candidate else { return false };
    if !matches!(candidate.effect, Effect::WornMass | Effect::HandLoad) {
        return false;
    }
    let rival = Candidate::new(Effect::ForceGain, Place::Whole, 0.0, candidate.scope);
    let (directions, residual) = gram.directions_given(accepted);
    let own = gram.score_alone(candidate, &directions, &residual);
    gram.score_alone(&rival, &directions, &residual) > own - OVER_A_GAIN
}

/// Log Bayes factor of a term from the rows of the centre of pressure alone.
pub(crate) fn from_cop_alone(gram: &Gram<'_>, accepted: &[usize], term: usize) -> f64 {
    let rows = gram.cop_rows();
    let odds = |terms: &[usize]| {
        let columns = gram.columns_of(terms);
        let (mean, sigma) = gram.beliefs(terms);
        let part = |column: usize| &gram.columns[columns[column]][..rows];
        log_odds(
            &|i, j| crate::linear::dot(part(i), part(j)),
            &|i| crate::linear::dot(part(i), &gram.residual[..rows]),
            &mean,
            &sigma,
        )
    };
    let with: Vec<usize> = accepted.iter().copied().chain([term]).collect();
    odds(&with) - odds(accepted)
}

impl Candidate {
    /// The effect's parameters, where the fitted one may be a factor on the shape.
    pub(crate) fn parameters(&self, value: &[f64]) -> [f64; PARAMETERS_MAX] {
        let mut parameters = [0.0; PARAMETERS_MAX];
        if self.is_a_share() {
            parameters[0] = self.reported_shape(value);
        } else {
            parameters.iter_mut().zip(value).for_each(|(parameter, value)| *parameter = *value);
        }
        parameters
    }

    /// The shape, including its fitted factor.
    pub(crate) fn reported_shape(&self, value: &[f64]) -> f64 {
        match self.effect {
            Effect::SuitLag => self.shape * value[0],
            // Twice the change of a slow filter corresponds to a filter twice as slow, as long as both are small.
            Effect::PlateLowpass => self.shape / value[0].max(0.05),
            _ => self.shape,
        }
    }
}
