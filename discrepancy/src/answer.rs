//! Assembles the finding.

use std::collections::BTreeMap;

use equipoise_config::model_file::Ask;
use equipoise_core::body::Segment;
use equipoise_core::effect::{Effect, Place};
use nalgebra::DMatrix;
use serde_json::Value;

use crate::candidate::{Candidate, Scope, place_name};
use crate::constants::{OPEN_END_BLOCKS, PARAMETER_ERROR};
use crate::finding::{AxisGap, Estimate, Finding, Gap, Generic, Named, Verdict};
use crate::floor::{Floor, root_mean};
use crate::gram::Gram;
use crate::holdout::HeldOut;
use crate::linear::{column, norm};
use crate::locate::locate;
use crate::picture::Signal;
use crate::reconcile::Fitted;
use crate::refine::shape_sigma;
use crate::select::{Accepted, Selection, estimate_last, padded};
use crate::session::PARAMETERS;
use crate::verdict::{Remainder, verdict};

/// The finding and the quantities from which it was made.
pub(crate) struct Answer {
    /// The finding.
    pub(crate) finding: Finding,
    /// The terms of the model.
    pub(crate) terms: Vec<Fitted>,
    /// The remaining residual.
    pub(crate) rest: Remainder,
    /// Level of noise alone.
    pub(crate) floor: Floor,
}

/// Residuals on held-out blocks, the remaining residual, and the level of noise alone.
pub(crate) struct Residuals<'a> {
    /// Residuals before and after, on held-out blocks.
    pub(crate) held: &'a HeldOut,
    /// The remaining residual, whitened.
    pub(crate) rest: Remainder,
    /// Level of noise alone.
    pub(crate) floor: Floor,
}

/// Assembles the finding.
pub(crate) fn assemble(
    gram: &Gram<'_>,
    selection: &Selection,
    generics: Vec<Generic>,
    residuals: Residuals<'_>,
) -> Answer {
    let Residuals { held, rest, floor } = residuals;
    let accepted = selection.terms();
    let verdict = verdict(selection, &rest);
    let terms: Vec<Fitted> =
        selection.accepted.iter().filter_map(|one| fitted(gram, &accepted, one)).collect();
    let effects =
        selection.accepted.iter().zip(&terms).filter_map(|(one, fitted)| named(gram, one, fitted)).collect();
    let ask = selection.ask.clone();
    let finding = Finding {
        verdict,
        // A residual beyond noise that the posterior does not explain is not decided.
        decided: selection.is_decided && (verdict == Verdict::Unexplained) == selection.is_outside,
        effects,
        candidates: selection.considered.clone(),
        set_aside: selection.set_aside.clone(),
        unexplained: match verdict {
            Verdict::Unexplained if generics.is_empty() => selection.outside.clone().into_iter().collect(),
            Verdict::Unexplained => generics,
            _ => Vec::new(),
        },
        gap: gap(gram, &floor, held),
        spans: locate(gram, &floor, &held.before),
        ask_next: ask.as_ref().map(Ask::sentence),
        ask,
        model: None,
    };
    Answer { finding, terms, rest, floor }
}

fn fitted(gram: &Gram<'_>, accepted: &[usize], one: &Accepted) -> Option<Fitted> {
    let candidate = gram.terms[one.term].candidate.as_ref()?;
    let estimate = estimate_last(gram, accepted, one.term)?;
    let others: Vec<usize> = accepted.iter().copied().filter(|&other| other != one.term).collect();
    let error = parameter_error(gram, candidate);
    let is_shaped = matches!(candidate.effect, Effect::PeriodicSway | Effect::SuitLag | Effect::PlateLowpass)
        || (candidate.effect == Effect::PlateDrift && candidate.shape > 0.0);
    let mut term = candidate.term(gram.rows, candidate.parameters(&estimate.value));
    term.shape = candidate.reported_shape(&estimate.value);
    if let Scope::Span([_, to_s]) = candidate.scope {
        let rows = gram.rows;
        let last_s = rows.time_s(rows.len() - 1);
        let near_s = OPEN_END_BLOCKS * rows.session.block_s;
        term.span_s[1] = if to_s >= last_s - near_s { f64::INFINITY } else { to_s };
    }
    let of_shape = if is_shaped { shape_sigma(gram, candidate, &others) } else { 0.0 };
    // The shape of an effect without one is 0.
    let shape_sigma = of_shape.hypot(error * term.shape);
    let mut sigma = padded(&estimate.sigma);
    let depends_on_shape = is_shaped && !candidate.is_shape_factor();
    let moved = depends_on_shape.then(|| with_shape_moved(gram, candidate, &others, of_shape)).flatten();
    let moved = moved.map_or(term.value, |value| padded(&value));
    for ((sigma, value), moved) in sigma.iter_mut().zip(term.value).zip(moved) {
        *sigma = sigma.hypot(error * value).hypot(moved - value);
    }
    if candidate.is_shape_factor() {
        sigma[0] = shape_sigma;
    }
    Some(Fitted { term, sigma, shape_sigma, log_odds: one.log_odds })
}

/// The parameters where the shape is 1 σ larger: those of a drift or a sway depend on its shape.
fn with_shape_moved(
    gram: &Gram<'_>,
    candidate: &Candidate,
    others: &[usize],
    shape_sigma: f64,
) -> Option<Vec<f64>> {
    let mut moved = gram.clone();
    let term = moved.add_candidate(Candidate { shape: candidate.shape + shape_sigma, ..candidate.clone() });
    Some(estimate_last(&moved, others, term)?.value)
}

/// Model error of an effect's own equation, 1-σ as a fraction of its parameters: bodies are not rigid, filters not of
/// first order, and a rotation moves the identified parameters of its segment. It adds to the noise.
fn parameter_error(gram: &Gram<'_>, candidate: &Candidate) -> f64 {
    let [of_inertia_and_filter, of_any] = PARAMETER_ERROR;
    match (candidate.effect, candidate.place) {
        (Effect::Inertia | Effect::PlateLowpass, _) => of_inertia_and_filter,
        (Effect::SegmentHeading | Effect::SegmentMisalignment, Place::Segment(segment)) => {
            of_any.hypot(identification_error(gram, segment))
        }
        _ => of_any,
    }
}

/// Error of a segment's parameters after identification and clean work, 1-σ as a fraction of their length.
fn identification_error(gram: &Gram<'_>, segment: Segment) -> f64 {
    let (rows, prior_m2) = (gram.rows, &gram.rows.session.prior_covariance_m2);
    let first = 3 * segment.index();
    let prior_m2 = |row: usize, axis: usize| prior_m2[row * PARAMETERS + first + axis];
    let before = 2 * rows.work_from;
    let mut on_cop = DMatrix::from_fn(before, 3, |row, axis| {
        let rotation = &rows.blocks[row / 2].observation.rotation;
        let moved = |world: usize| {
            (0..PARAMETERS).map(|j| rotation[j / 3][world][j % 3] * prior_m2(j, axis)).sum::<f64>()
        };
        rows.on_cop(row / 2, [moved(0), moved(1), moved(2)])[row % 2]
    });
    gram.noise.cop.whiten_from(0, &mut on_cop);
    let explained_m2: f64 = (0..3).flat_map(|axis| column(&on_cop, axis)).map(|value| value * value).sum();
    let before_m2: f64 = (0..3).map(|axis| prior_m2(first + axis, axis)).sum();
    let phi_m = rows.blocks[0].observation.phi_m[segment.index()];
    (before_m2 - explained_m2).max(0.0).sqrt() / norm(phi_m)
}

fn named(gram: &Gram<'_>, one: &Accepted, fitted: &Fitted) -> Option<Named> {
    let candidate = gram.terms[one.term].candidate.as_ref()?;
    Some(Named {
        name: candidate.effect.name().to_owned(),
        place: place(gram, candidate, fitted),
        parameters: parameters(candidate, fitted, gram.terms[one.term].count),
        log_odds: one.log_odds,
        probability: one.probability,
        runner_up: one.rivals.first().cloned(),
        family: family(candidate, one),
    })
}

fn place(gram: &Gram<'_>, candidate: &Candidate, fitted: &Fitted) -> BTreeMap<String, Value> {
    let mut place = BTreeMap::new();
    match candidate.place {
        Place::Whole => {}
        Place::Segment(_) => {
            place.insert("segment".to_owned(), Value::from(place_name(candidate.place)));
        }
        _ => {
            place.insert("hand".to_owned(), Value::from(place_name(candidate.place)));
        }
    }
    let end_s = gram.rows.session.spans_s.work[1];
    let [from_s, to_s] = fitted.term.span_s;
    place.insert("from_s".to_owned(), Value::from(from_s));
    place.insert("to_s".to_owned(), Value::from(to_s.min(end_s)));
    place
}

fn parameters(candidate: &Candidate, fitted: &Fitted, count: usize) -> BTreeMap<String, Estimate> {
    let declared = candidate.effect.parameters_of(candidate.shape);
    let mut parameters: BTreeMap<String, Estimate> = declared
        .iter()
        .zip(fitted.term.value.iter().zip(fitted.sigma))
        .take(count)
        .map(|(parameter, (&value, sigma))| {
            (parameter.name.to_owned(), Estimate { value, sigma, unit: parameter.unit })
        })
        .collect();
    if let Some(name) = candidate.effect.shape_name().filter(|_| fitted.shape_sigma > 0.0) {
        let unit = if name.ends_with("hz") { "Hz" } else { "s" };
        let shape = Estimate { value: fitted.term.shape, sigma: fitted.shape_sigma, unit };
        parameters.entry(name.to_owned()).or_insert(shape);
    }
    parameters
}

/// Effects that these data cannot distinguish from it: rivals, and its declared family.
fn family(candidate: &Candidate, one: &Accepted) -> Vec<String> {
    let mut family: Vec<String> = one.rivals.iter().map(|rival| rival.name.clone()).collect();
    for (effect, place) in candidate.effect.family(candidate.place) {
        let name = Candidate::new(effect, place, 0.0, Scope::Work).name();
        if !family.contains(&name) {
            family.push(name);
        }
    }
    family
}

fn gap(gram: &Gram<'_>, floor: &Floor, held: &HeldOut) -> Gap {
    let still = |block: usize| gram.rows.blocks[gram.rows.work_from + block].still;
    let mut per_axis = BTreeMap::new();
    let parts: [(&str, &dyn Fn(usize) -> bool); 3] =
        [("", &|_| true), ("_still", &still), ("_moving", &|block| !still(block))];
    for (axis, signal) in Signal::ALL.into_iter().enumerate() {
        for (part, of) in &parts {
            let root = |list: &[[f64; 3]]| {
                let some = (0..list.len()).filter(|&block| of(block));
                display_scale(axis) * root_mean(some.map(|block| list[block][axis].powi(2)))
            };
            let noise_floor = display_scale(axis) * floor.root_mean_square(axis, of);
            let one = AxisGap {
                before: root(&held.before),
                after: root(&held.after),
                noise_floor,
                unit: signal.unit(),
            };
            if noise_floor > 0.0 {
                per_axis.insert(format!("{}{part}", signal.axis()), one);
            }
        }
    }
    let both = |of: &dyn Fn(&AxisGap) -> f64| {
        let axes = ["x", "y"].into_iter().filter_map(|axis| per_axis.get(axis));
        axes.map(|gap| of(gap).powi(2)).sum::<f64>().sqrt()
    };
    let (before_mm, after_mm, noise_floor_mm) =
        (both(&|gap| gap.before), both(&|gap| gap.after), both(&|gap| gap.noise_floor));
    Gap { before_mm, after_mm, noise_floor_mm, held_out: true, per_axis }
}

/// Factor from metres and newtons to the unit of a signal.
pub(crate) fn display_scale(axis: usize) -> f64 {
    if axis < 2 { 1e3 } else { 1.0 }
}
