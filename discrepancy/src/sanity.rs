//! What a good fit alone does not make an explanation: too small to matter, a mass that is not where it is worn, a weight
//! that only one channel wants.

use equipoise_core::effect::{Effect, PARAMETERS_MAX};

use crate::candidate::Candidate;
use crate::evidence::log_odds;
use crate::gram::Gram;

/// A term acting on forces and the centre of pressure must be wanted by the latter alone by this much, in log odds.
const FROM_COP_ALONE: f64 = 3.0;
/// A first moment may be so many of its believed arms.
const ARMS: f64 = 2.5;
/// A share of a lag or filter is near one if the shape is right.
const LEAST_SHARE: f64 = 0.3;

/// The size of an effect with these parameters ([`Effect::size`]).
pub(crate) fn size(candidate: &Candidate, value: &[f64]) -> f64 {
    let parameters = candidate.parameters(value);
    candidate.effect.size(candidate.told_shape(value), &parameters)
}

/// Why an explanation does not count, if so.
pub(crate) fn objection(candidate: &Candidate, value: &[f64]) -> Option<String> {
    let size = size(candidate, value);
    if size < candidate.effect.smallest_of_interest() {
        return Some("smaller than what matters".to_owned());
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

/// Whether what speaks for a term is only the forces: then it is no mass and no turned segment.
pub(crate) fn only_by_forces(gram: &Gram<'_>, accepted: &[usize], term: usize) -> bool {
    let Some(candidate) = &gram.terms[term].candidate else { return false };
    let is_only_force = candidate.effect == Effect::ForceGain;
    !is_only_force && from_cop_alone(gram, accepted, term) < FROM_COP_ALONE
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
    /// The effect's parameters, where the fitted one may be a share of the shape.
    pub(crate) fn parameters(&self, value: &[f64]) -> [f64; PARAMETERS_MAX] {
        let mut parameters = [0.0; PARAMETERS_MAX];
        if self.is_a_share() {
            parameters[0] = self.told_shape(value);
        } else {
            parameters.iter_mut().zip(value).for_each(|(parameter, value)| *parameter = *value);
        }
        parameters
    }

    /// The shape, with the share in it where one is fitted.
    pub(crate) fn told_shape(&self, value: &[f64]) -> f64 {
        match self.effect {
            Effect::SuitLag => self.shape * value[0],
            // Twice the share of a slow filter's change is that of a filter twice as slow, as far as both are small.
            Effect::PlateLowpass => self.shape / value[0].max(0.05),
            _ => self.shape,
        }
    }
}
