//! The next pose or motion that discriminates between explanations which these data cannot separate. Candidates are all
//! poses of the library (also turned and displaced), long standing and fast motion; the choice maximises the separation
//! of the predictions of the two leading explanations.

use equipoise_config::model_file::Ask;
use equipoise_core::body::{SEGMENTS, Segment, Side};
use equipoise_core::effect::{Effect, Observation};
use equipoise_core::pose_suggestion::library::LIBRARY;
use nalgebra::{UnitQuaternion, Vector3};

use crate::candidate::Candidate;
use crate::constants::{FASTER, RELATIVE, SEPARATION_MIN, STANDING_S, STEP_M, TURNS_DEG};
use crate::evidence::Estimate;
use crate::floor::Floor;
use crate::gram::Gram;
use crate::linear::norm;
use crate::select::{Selection, estimate_last, padded};
use crate::trials::trials;

/// An explanation with its fitted parameters.
struct Hypothesis {
    candidate: Candidate,
    estimate: Estimate,
}

/// The pose or motion that best separates the two leading explanations; `None` if there are no two, or if none
/// separates them.
pub(crate) fn ask(gram: &Gram<'_>, selection: &Selection, floor: &Floor) -> Option<Ask> {
    let [one, other] = leading(gram, selection)?;
    let sigma: [f64; 3] = std::array::from_fn(|axis| floor.root_mean_square(axis, |_| true).max(1e-6));
    let separation = |a: [f64; 3], b: [f64; 3]| {
        (0..3).map(|axis| ((a[axis] - b[axis]) / sigma[axis]).powi(2)).sum::<f64>().sqrt()
    };
    let between = [one.candidate.name(), other.candidate.name()];
    let mut best: Option<Ask> = None;
    let mut consider = |separation_sigma: f64, what: Ask| {
        let max = best.as_ref().map_or(SEPARATION_MIN, |best| best.separation_sigma);
        if separation_sigma.is_finite() && separation_sigma > max {
            best = Some(Ask { separation_sigma, between: between.clone(), ..what });
        }
    };
    for (what, seen) in activities(gram) {
        consider(separation(one.predicts(gram, &seen), other.predicts(gram, &seen)), what);
    }
    let fast = fastest(gram)?;
    let what = Ask { fast: true, ..empty() };
    consider(separation(one.predicts_at(gram, fast), other.predicts_at(gram, fast)), what);
    best
}

/// An empty request, to be filled in.
fn empty() -> Ask {
    Ask {
        between: Default::default(),
        pose: None,
        turn_deg: 0.0,
        step_m: [0.0; 2],
        still_s: 0.0,
        fast: false,
        separation_sigma: 0.0,
    }
}

impl Hypothesis {
    /// Predicted change for a hypothetical observation: centre of pressure x, y (m), vertical force (N).
    fn predicts(&self, gram: &Gram<'_>, seen: &Observation) -> [f64; 3] {
        let mut term = self.candidate.term(gram.rows, self.candidate.parameters(&self.estimate.value));
        term.span_s[1] = f64::INFINITY;
        let ([x, y], [_, _, z]) = term.columns(seen).times(&term.value);
        [x, y, z]
    }

    /// Predicted change at a block if its motion were faster.
    fn predicts_at(&self, gram: &Gram<'_>, block: usize) -> [f64; 3] {
        let columns = self.candidate.columns(gram.rows, block);
        let value = padded(&self.estimate.value);
        let ([x, y], [_, _, z]) = columns.times(&value);
        let is_of_motion =
            matches!(self.candidate.effect, Effect::SuitLag | Effect::PlateLowpass | Effect::Inertia);
        let factor = if is_of_motion { FASTER } else { 1.0 };
        [x, y, z].map(|part| factor * part)
    }
}

/// The first named effect with a rival or a near relative, and that alternative.
fn leading(gram: &Gram<'_>, selection: &Selection) -> Option<[Hypothesis; 2]> {
    for accepted in &selection.accepted {
        let others: Vec<usize> =
            selection.terms().into_iter().filter(|&term| term != accepted.term).collect();
        let candidate = gram.terms[accepted.term].candidate.clone()?;
        let rivals: Vec<String> = accepted.rivals.iter().map(|rival| rival.name.clone()).collect();
        let near = accepted.log_odds - RELATIVE.0.max(RELATIVE.1 * accepted.log_odds);
        let is_relative =
            |other: &Candidate| candidate.effect.is_family_of(candidate.place, other.effect, other.place);
        let alternative = trials(gram, &gram.conditioned_on(&others)).into_iter().find(|trial| {
            let other = gram.terms[trial.term].candidate.as_ref();
            trial.name != accepted.name
                && (rivals.contains(&trial.name) || (trial.log_odds > near && other.is_some_and(is_relative)))
        });
        if let Some(trial) = alternative {
            let one = Hypothesis { estimate: estimate_last(gram, &others, accepted.term)?, candidate };
            let candidate = gram.terms[trial.term].candidate.clone()?;
            return Some([
                one,
                Hypothesis { estimate: estimate_last(gram, &others, trial.term)?, candidate },
            ]);
        }
    }
    None
}

/// All activities that can be requested of a standing subject, as the model would observe them.
fn activities(gram: &Gram<'_>) -> Vec<(Ask, Observation)> {
    let rows = gram.rows;
    let Some(last) = rows.blocks.last() else { return Vec::new() };
    let seen = &last.observation;
    let mut list = Vec::new();
    for posture in LIBRARY {
        for turn_deg in TURNS_DEG {
            let what = Ask { pose: Some(posture.name.to_owned()), turn_deg, ..empty() };
            list.push((what, standing(seen, &posture.world_from_segment(), turn_deg, [0.0; 2])));
        }
    }
    let straight = LIBRARY[0].world_from_segment();
    let step_m = [STEP_M, STEP_M];
    list.push((Ask { step_m, ..empty() }, standing(seen, &straight, 0.0, step_m)));
    let mut later = standing(seen, &straight, 0.0, [0.0; 2]);
    later.time_s += STANDING_S;
    list.push((Ask { still_s: STANDING_S, ..empty() }, later));
    list
}

/// The block of the work with the largest acceleration.
fn fastest(gram: &Gram<'_>) -> Option<usize> {
    let acceleration = |block: usize| norm(gram.rows.blocks[block].observation.com_acceleration_m_per_s2);
    (gram.rows.work_from..gram.rows.len()).max_by(|&a, &b| acceleration(a).total_cmp(&acceleration(b)))
}

/// A static subject of this skeleton in a pose, turned by an angle about the feet and displaced from the present
/// position.
fn standing(
    like: &Observation,
    rotation: &[UnitQuaternion<f64>; SEGMENTS],
    turn_deg: f64,
    step_m: [f64; 2],
) -> Observation {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * turn_deg.to_radians());
    let rotation = rotation.map(|own| turn * own);
    let origin = origins_in_pose(like, &rotation, step_m);
    let com = Segment::ALL
        .iter()
        .map(|segment| rotation[segment.index()] * Vector3::from(like.phi_m[segment.index()]))
        .fold(origin[0], |sum, part| sum + part);
    let cop_m = [com.x, com.y];
    let force_n = [0.0, 0.0, like.mass_kg * 9.81];
    Observation {
        feet_m: [like.feet_m[0] + step_m[0], like.feet_m[1] + step_m[1]],
        origin_m: origin.map(Into::into),
        origin_acceleration_m_per_s2: [[0.0; 3]; SEGMENTS],
        rotation: rotation.map(|own| {
            let matrix = own.to_rotation_matrix();
            [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[(row, column)]))
        }),
        rotation_acceleration_per_s2: [[[0.0; 3]; 3]; SEGMENTS],
        com_m: com.into(),
        com_acceleration_m_per_s2: [0.0; 3],
        turning_m: [0.0; 2],
        slope: [0.0; 2],
        cop_predicted_m: cop_m,
        force_predicted_n: force_n,
        cop_measured_m: cop_m,
        force_measured_n: force_n,
        ..*like
    }
}

/// Segment origins in a pose, with the middle between the feet in its place, plus a step.
fn origins_in_pose(
    like: &Observation,
    rotation: &[UnitQuaternion<f64>; SEGMENTS],
    step_m: [f64; 2],
) -> [Vector3<f64>; SEGMENTS] {
    let seen = |segment: Segment| Vector3::from(like.origin_m[segment.index()]);
    let mut origin = [Vector3::zeros(); SEGMENTS];
    for segment in Segment::ALL {
        let Some(parent) = segment.parent() else { continue };
        let rows = like.rotation[parent.index()];
        let along = seen(segment) - seen(parent);
        let own = Vector3::from_fn(|k, _| (0..3).map(|axis| rows[axis][k] * along[axis]).sum::<f64>());
        origin[segment.index()] = origin[parent.index()] + rotation[parent.index()] * own;
    }
    let middle = |origin: &dyn Fn(Segment) -> Vector3<f64>| {
        Side::BOTH.iter().map(|side| origin(side.foot())).sum::<Vector3<f64>>() * 0.5
    };
    let shift =
        middle(&seen) - middle(&|segment| origin[segment.index()]) + Vector3::new(step_m[0], step_m[1], 0.0);
    origin.map(|origin| origin + shift)
}
