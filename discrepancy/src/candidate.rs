//! Candidates: every effect of the catalogue, at every place where it can act, with every shape of a coarse grid.

use equipoise_core::body::{Segment, Side};
use equipoise_core::effect::{self, Columns, Effect, PARAMETERS_MAX, Place};

use crate::block::{Block, Change};
use crate::constants::{
    CUTOFF_FACTOR_MIN, CUTOFFS_HZ, DRIFTS_S, HEADINGS, LAGS_S, SHAPE_FACTOR_SIGMA, SWAYS_HZ,
    WORN_PLACE_LOG_PRIOR,
};
use crate::rows::Rows;

/// Time span of a candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Scope {
    /// The whole recording, identification included.
    All,
    /// In the work in question.
    Work,
    /// In a part of it: start and end, s.
    Span([f64; 2]),
}

impl Scope {
    /// Whether effects with these scopes act at the same time.
    pub(crate) fn overlaps(self, other: Scope) -> bool {
        match (self, other) {
            (Scope::Span(one_s), Scope::Span(other_s)) => one_s[0] < other_s[1] && other_s[0] < one_s[1],
            _ => true,
        }
    }
}

/// An effect at a place, with a shape, at a time.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Candidate {
    /// The effect.
    pub(crate) effect: Effect,
    /// Its place.
    pub(crate) place: Place,
    /// The non-linear parameter ([`effect::Term::shape`]).
    pub(crate) shape: f64,
    /// Its time span.
    pub(crate) scope: Scope,
    /// Large rotations are not linear in their angle: the parameters at which the columns are linearised; 0 for small
    /// ones.
    pub(crate) about: [f64; PARAMETERS_MAX],
    /// Prior mean of the parameters.
    pub(crate) mean: Vec<f64>,
    /// Prior 1-σ.
    pub(crate) sigma: Vec<f64>,
    /// Logarithm of its prior weight among the variants of its name.
    pub(crate) log_prior: f64,
}

impl Candidate {
    /// A candidate with the effect's own prior.
    pub(crate) fn new(effect: Effect, place: Place, shape: f64, scope: Scope) -> Candidate {
        let sigma = effect.prior_sigma(place, shape)[..effect.parameters().len()].to_vec();
        let mean = vec![0.0; sigma.len()];
        let mut candidate = Candidate {
            effect,
            place,
            shape,
            scope,
            about: [0.0; PARAMETERS_MAX],
            mean,
            sigma,
            log_prior: 0.0,
        };
        if candidate.is_shape_factor() {
            candidate.mean = vec![1.0];
            candidate.sigma = vec![SHAPE_FACTOR_SIGMA[0]];
        }
        candidate
    }

    /// Whether its only parameter is a factor near one on what its shape predicts.
    pub(crate) fn is_shape_factor(&self) -> bool {
        matches!(self.effect, Effect::SuitLag | Effect::PlateLowpass)
    }

    /// The same candidate with a heading prior about an angle, with 1-σ and weight in the mixture.
    fn heading(&self, (psi_rad, sigma_rad, weight): (f64, f64, f64)) -> Candidate {
        let mut about = self.about;
        about[0] = psi_rad;
        let log_prior = self.log_prior + weight.ln();
        Candidate { about, mean: vec![psi_rad], sigma: vec![sigma_rad], log_prior, ..self.clone() }
    }

    /// Number of columns.
    pub(crate) fn count(&self) -> usize {
        self.sigma.len()
    }

    /// Name with place: `worn_mass T8`.
    pub(crate) fn name(&self) -> String {
        match self.place {
            Place::Whole => self.effect.name().to_owned(),
            place => format!("{} {}", self.effect.name(), place_name(place)),
        }
    }

    /// Whether it acts at the time of a block.
    pub(crate) fn acts(&self, rows: &Rows<'_>, block: usize) -> bool {
        match self.scope {
            Scope::All => true,
            Scope::Work => block >= rows.work_from,
            Scope::Span([from_s, to_s]) => {
                block >= rows.work_from && (from_s..to_s).contains(&rows.time_s(block))
            }
        }
    }

    /// Its time span, s.
    pub(crate) fn span_s(&self, rows: &Rows<'_>) -> [f64; 2] {
        match self.scope {
            Scope::All => [0.0, f64::INFINITY],
            Scope::Work => [rows.session.spans_s.work[0], f64::INFINITY],
            Scope::Span(span_s) => span_s,
        }
    }

    /// The loop's own term with these parameters.
    pub(crate) fn term(&self, rows: &Rows<'_>, value: [f64; PARAMETERS_MAX]) -> effect::Term {
        let span_s = self.span_s(rows);
        effect::Term { effect: self.effect, place: self.place, shape: self.shape, value, span_s }
    }

    /// Its columns at a block.
    pub(crate) fn columns(&self, rows: &Rows<'_>, block: usize) -> Columns {
        if !self.acts(rows, block) {
            return Columns::zero(self.count());
        }
        let at = rows.blocks[block];
        match self.effect {
            Effect::SuitLag => of_change(lag_change(at, self.shape)),
            Effect::PlateLowpass => of_change(cutoff_change(&at.by_cutoff, self.shape)),
            _ => self.term(rows, self.about).columns(&at.observation),
        }
    }

    /// The effect's parameters, where the fitted one may be a factor on the shape.
    pub(crate) fn parameters(&self, value: &[f64]) -> [f64; PARAMETERS_MAX] {
        let mut parameters = [0.0; PARAMETERS_MAX];
        if self.is_shape_factor() {
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
            Effect::PlateLowpass => self.shape / value[0].max(CUTOFF_FACTOR_MIN),
            _ => self.shape,
        }
    }

    /// The size of the effect with these parameters ([`Effect::size`]).
    pub(crate) fn size(&self, value: &[f64]) -> f64 {
        self.effect.size(self.reported_shape(value), &self.parameters(value))
    }
}

/// `right`, `both`, `T8`; empty for the whole body.
pub(crate) fn place_name(place: Place) -> &'static str {
    match place {
        Place::Whole => "",
        Place::Hand(Side::Left) => "left",
        Place::Hand(Side::Right) => "right",
        Place::BothHands => "both",
        Place::Segment(segment) => segment.name(),
    }
}

/// All candidates that act during the whole work phase or the whole recording.
pub(crate) fn all(rows: &Rows<'_>) -> Vec<Candidate> {
    let mut list = Vec::new();
    for effect in Effect::ALL {
        let of_effect = of_effect(effect, rows);
        list.extend(of_effect);
    }
    list
}

fn of_effect(effect: Effect, rows: &Rows<'_>) -> Vec<Candidate> {
    let shapes = shapes(effect);
    let scopes = scopes(effect, rows);
    let mut list = Vec::new();
    for &place in effect.places() {
        for &shape in &shapes {
            for &scope in &scopes {
                let mut candidate = Candidate::new(effect, place, shape, scope);
                candidate.log_prior =
                    place_log_prior(effect, place) - ((shapes.len() * scopes.len()) as f64).ln();
                if effect == Effect::SegmentHeading {
                    list.extend(HEADINGS.map(|heading| candidate.heading(heading)));
                } else {
                    list.push(candidate);
                }
            }
        }
    }
    list
}

/// Log prior of a place: loads are usually worn on back and belt, held in hands, strapped to thighs and forearms, and
/// rarely on head, upper arms and shins.
pub(crate) fn place_log_prior(effect: Effect, place: Place) -> f64 {
    let [limb, elsewhere] = WORN_PLACE_LOG_PRIOR;
    match (effect, place) {
        (Effect::WornMass, Place::Segment(Segment::T8 | Segment::Pelvis)) => 0.0,
        (Effect::WornMass, Place::Segment(segment)) => {
            let thigh = [Segment::RightUpperLeg, Segment::LeftUpperLeg];
            let forearm = [Segment::RightForearm, Segment::LeftForearm];
            if thigh.contains(&segment) || forearm.contains(&segment) { limb } else { elsewhere }
        }
        _ => 0.0,
    }
}

fn shapes(effect: Effect) -> Vec<f64> {
    match effect {
        Effect::PlateDrift => DRIFTS_S.to_vec(),
        Effect::PlateLowpass => CUTOFFS_HZ.to_vec(),
        Effect::SuitLag => LAGS_S.to_vec(),
        Effect::PeriodicSway => SWAYS_HZ.to_vec(),
        _ => vec![0.0],
    }
}

fn scopes(effect: Effect, rows: &Rows<'_>) -> Vec<Scope> {
    match effect {
        Effect::Inertia => vec![Scope::All],
        Effect::PlateOffset
        | Effect::PlateYaw
        | Effect::PlateGain
        | Effect::PlateCrosstalk
        | Effect::PlateHeight
        | Effect::ForceGain
        | Effect::SuitLag
        | Effect::PlateLowpass
            if rows.work_from > 0 =>
        {
            vec![Scope::Work, Scope::All]
        }
        _ => vec![Scope::Work],
    }
}

fn of_change(change: Change) -> Columns {
    let mut columns = Columns::zero(1);
    columns.cop_m[0] = change.cop_m;
    columns.force_n[0] = change.force_n;
    columns
}

/// Change by a lag: cubic interpolation through the nearest four stored lags; lag zero with no change is one of the
/// nodes.
fn lag_change(block: &Block, lag_s: f64) -> Change {
    let zero = LAGS_S.iter().take_while(|&&kept_s| kept_s < 0.0).count();
    let at = |i: usize| match i.cmp(&zero) {
        std::cmp::Ordering::Less => (LAGS_S[i], block.by_lag[i]),
        std::cmp::Ordering::Equal => (0.0, Change::NONE),
        std::cmp::Ordering::Greater => (LAGS_S[i - 1], block.by_lag[i - 1]),
    };
    interpolated(lag_s, LAGS_S.len() + 1, at)
}

/// Change by a cutoff frequency: interpolated between the stored ones, over the time constant.
pub(crate) fn cutoff_change(by_cutoff: &[Change; CUTOFFS_HZ.len()], cutoff_hz: f64) -> Change {
    let last = CUTOFFS_HZ.len();
    let at = |i: usize| match i {
        0 => (0.0, Change::NONE),
        _ => (1.0 / CUTOFFS_HZ[last - i], by_cutoff[last - i]),
    };
    // Slower filters than the slowest stored one change as much as that.
    interpolated(1.0 / cutoff_hz.max(CUTOFFS_HZ[0]), last + 1, at)
}

/// Lagrange's cubic through the four knots nearest to a value; knots ascending.
fn interpolated(value: f64, knots: usize, at: impl Fn(usize) -> (f64, Change)) -> Change {
    let above = (0..knots).position(|i| at(i).0 >= value).unwrap_or(knots - 1);
    let first = above.saturating_sub(2).min(knots - PARAMETERS_MAX);
    let mut sum = Change::NONE;
    for i in first..first + 4 {
        let (knot, change) = at(i);
        let weight: f64 =
            (first..first + 4).filter(|&j| j != i).map(|j| (value - at(j).0) / (knot - at(j).0)).product();
        sum.add(weight, &change);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_between_two_stored_cutoffs_is_interpolated_by_delay() {
        let by_cutoff =
            CUTOFFS_HZ.map(|cutoff_hz| Change { cop_m: [1.0 / cutoff_hz, 0.0], force_n: [0.0; 3] });
        for cutoff_hz in [0.5, 0.6, 1.0, 2.5, 6.9, 7.0, 20.0] {
            let change = cutoff_change(&by_cutoff, cutoff_hz);
            assert!((change.cop_m[0] - 1.0 / cutoff_hz).abs() < 1e-12, "{cutoff_hz}");
        }
        assert_eq!(cutoff_change(&by_cutoff, 0.4), cutoff_change(&by_cutoff, 0.5));
    }

    #[test]
    fn the_weights_of_the_headings_sum_to_one_and_signs_are_symmetric() {
        assert!((HEADINGS.iter().map(|(_, _, weight)| weight).sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(HEADINGS.iter().all(|(about_rad, ..)| {
            HEADINGS.iter().any(|(other_rad, ..)| (other_rad + about_rad).abs() < 1e-12)
        }));
    }
}
