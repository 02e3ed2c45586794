//! The next experiment: the poses, step, standing or motion with the largest expected information about which effects
//! act (D. V. Lindley, Ann. Math. Stat. 27 (1956), 986–1005).
//!
//! Each probable explanation predicts the response, with the uncertainty of its parameters, its misfit and the noise.
//! Something outside the catalogue is as large as in the work, in an unknown direction; a turn or a step has a stance
//! offset of its own.
//! Responses are drawn from these predictions; the mean decrease of the entropy of the names' probabilities is the
//! expected information.

mod experiment;

use equipoise_config::model_file::Ask;
use equipoise_core::body::Side;
use equipoise_core::effect::{Effect, PARAMETERS_MAX};
use faer::Mat;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use crate::candidate::{Candidate, Scope};
use crate::constants::{
    EVIDENCE_TEMPER, FASTER, INFORMATION_MIN, OPEN_END_BLOCKS, RESPONSES, SEEDS, STANCE_M,
};
use crate::evidence::log_sum_exp;
use crate::explanation::model_error;
use crate::floor::Floor;
use crate::linear::{Factor, product};
use crate::picture::Signal;
use crate::posterior::{NameSets, Predictor};
use crate::rows::Rows;
use crate::select::{Selection, padded};
use crate::trials::normal;
use experiment::{Experiment, Measurement};

/// Number of signals of a measurement: centre of pressure x, y (m), vertical force (N).
const SIGNALS: usize = Signal::ALL.len();

/// The experiment with the largest expected information; `None` if one set of names is certain already, or if no
/// experiment is informative.
pub(crate) fn ask(rows: &Rows<'_>, selection: &Selection, floor: &Floor) -> Option<Ask> {
    let question = Question::of(rows, &selection.predictors, floor)?;
    let best_of = |experiments: Vec<Experiment>| {
        let rated = experiments.into_iter().filter_map(|one| Some((question.information_nats(&one)?, one)));
        rated.reduce(|best, one| if one.0 > best.0 { one } else { best })
    };
    let mut best = best_of(experiment::single(rows))?;
    while let Some(longer) = best_of(experiment::with_another_pose(rows, &best.1)) {
        if longer.0 <= best.0 {
            break;
        }
        best = longer;
    }
    let (information_nats, experiment) = best;
    let responses = question.responses(&experiment)?;
    let separation_sigma = question.separation_sigma(&responses);
    let decides = question.decides(&responses);
    let between = question.between();
    (information_nats >= INFORMATION_MIN).then_some(Ask {
        between,
        information_nats,
        decides,
        separation_sigma,
        ..experiment.ask
    })
}

/// The probable explanations, and what their predictions are compared with.
struct Question<'a> {
    rows: &'a Rows<'a>,
    predictors: &'a [Predictor],
    /// Probability of each.
    prior: Vec<f64>,
    /// Of each explanation: the first one with the same names.
    class: Vec<usize>,
    /// Noise of each signal, 1-σ.
    sigma: [f64; SIGNALS],
}

/// Predicted signals of an experiment.
struct Response {
    mean: Vec<f64>,
    factor: Factor,
}

impl<'a> Question<'a> {
    /// `None` if there is nothing to decide, or if no explanation could be fitted.
    fn of(rows: &'a Rows<'a>, predictors: &'a [Predictor], floor: &Floor) -> Option<Question<'a>> {
        let first =
            |one: &Predictor| predictors.iter().position(|other| other.names == one.names).unwrap_or(0);
        (!predictors.is_empty()).then(|| Question {
            rows,
            predictors,
            prior: predictors.iter().map(|one| one.probability).collect(),
            class: predictors.iter().map(first).collect(),
            sigma: std::array::from_fn(|axis| floor.root_mean_square(axis, |_| true).max(1e-6)),
        })
    }

    /// The two most probable sets of names, as indices of predictors.
    fn leading(&self) -> [usize; 2] {
        let sums = of_classes(&self.class, &self.prior);
        let mut order: Vec<usize> = (0..sums.len()).collect();
        order.sort_by(|&a, &b| sums[b].total_cmp(&sums[a]));
        [order[0], *order.get(1).unwrap_or(&order[0])]
    }

    /// A name of each of the two most probable sets that the other lacks.
    fn between(&self) -> [String; 2] {
        let [one, other] = self.leading().map(|index| &self.predictors[index].names);
        let own = |names: &[String], others: &[String]| {
            let own = names.iter().find(|name| !others.contains(name));
            own.cloned().unwrap_or_else(|| "no such effect".to_owned())
        };
        [own(one, other), own(other, one)]
    }

    /// Expected information of an experiment, nats; `None` if a prediction is degenerate.
    fn information_nats(&self, experiment: &Experiment) -> Option<f64> {
        Some(information_nats(&self.prior, &self.class, &self.responses(experiment)?))
    }

    /// Probability that responses leave nothing to decide.
    fn decides(&self, responses: &[Response]) -> f64 {
        let sets = self.predictors.iter().map(|one| one.names.clone()).collect();
        let mut names = NameSets { sets, probabilities: Vec::new() };
        let decides = expectation(&self.prior, responses, |posterior| {
            posterior.clone_into(&mut names.probabilities);
            f64::from(u8::from(names.is_decided()))
        });
        // The weights' sum may exceed 1 by rounding.
        decides.min(1.0)
    }

    /// The prediction of each explanation; `None` if one is degenerate.
    fn responses(&self, experiment: &Experiment) -> Option<Vec<Response>> {
        self.predictors.iter().map(|one| self.response(one, experiment)).collect()
    }

    /// Root mean square distance of the predictions of the two most probable sets of names, 1-σ of the noise.
    fn separation_sigma(&self, responses: &[Response]) -> f64 {
        let leading = self.leading();
        let [one, other] = leading.map(|index| &responses[index].mean);
        let outside = leading.map(|index| self.predictors[index].outside);
        let squares = one.iter().zip(other).enumerate().map(|(i, (a, b))| {
            let signal = i % SIGNALS;
            let [c, d] = outside.map(|size| size[signal]);
            ((a - b).powi(2) + (c * c - d * d).abs()) / self.sigma[signal].powi(2)
        });
        squares.sum::<f64>().sqrt()
    }

    /// Predicted signals of all measurements, with the covariance of the parameters, of the misfit, of the stance offset
    /// and of the noise.
    fn response(&self, predictor: &Predictor, experiment: &Experiment) -> Option<Response> {
        let measurements = &experiment.measurements;
        let size = SIGNALS * measurements.len();
        let mut mean = vec![0.0; size];
        let of_noise = |i: usize| self.sigma[i % SIGNALS].powi(2) + predictor.outside[i % SIGNALS].powi(2);
        let mut variance: Vec<f64> = (0..size).map(of_noise).collect();
        let mut jacobian = Mat::zeros(size, predictor.value.len());
        let mut first = 0;
        for candidate in &predictor.effects {
            let count = candidate.count();
            let value = &predictor.value[first..first + count];
            let misfit = predictor.misfit_scale * model_error(candidate.effect).0;
            for (index, measurement) in measurements.iter().enumerate() {
                let change = self.change(candidate, value, measurement);
                for signal in 0..SIGNALS {
                    let row = SIGNALS * index + signal;
                    mean[row] += change.mean[signal];
                    variance[row] += (misfit * change.mean[signal]).powi(2);
                    for parameter in 0..count {
                        jacobian[(row, first + parameter)] = change.per_unit[parameter][signal];
                    }
                }
            }
            first += count;
        }
        let spread =
            product(product(jacobian.as_ref(), predictor.covariance.as_ref()).as_ref(), jacobian.transpose());
        let stance_m2 = self.stance_m2(&experiment.ask);
        let covariance = Mat::from_fn(size, size, |i, j| {
            let is_shared = i % SIGNALS == j % SIGNALS && Signal::ALL[i % SIGNALS] != Signal::Fz;
            let of_stance = if is_shared { stance_m2 } else { 0.0 };
            spread[(i, j)] + of_stance + if i == j { variance[i] } else { 0.0 }
        });
        Some(Response { mean, factor: Factor::of(&covariance)? })
    }

    /// Variance of the stance offset, relative to the present one: a turn or a step moves each foot at least once.
    fn stance_m2(&self, ask: &Ask) -> f64 {
        let [_, step_m] = STANCE_M[usize::from(!self.rows.session.suit_drifts)];
        let moves = ask.turn_deg != 0.0 || ask.step_m != [0.0; 2];
        if moves { Side::BOTH.len() as f64 * step_m * step_m } else { 0.0 }
    }

    /// Change of the signals by an effect.
    fn change(&self, candidate: &Candidate, value: &[f64], measurement: &Measurement) -> Change {
        let (columns, value, factor) = match measurement {
            Measurement::Static(_) if has_ended(candidate, self.rows) => return Change::default(),
            Measurement::Static(seen) => {
                let mut term = candidate.term(self.rows, candidate.parameters(value));
                term.span_s[1] = f64::INFINITY;
                (term.columns(seen), term.value, 1.0)
            }
            Measurement::Fast(block) if is_of_motion(candidate.effect) => {
                (candidate.columns(self.rows, *block), padded(value), FASTER)
            }
            // The same posture was measured already.
            Measurement::Fast(_) => return Change::default(),
        };
        let mut change = Change::default();
        for (parameter, per_unit) in change.per_unit.iter_mut().enumerate() {
            let ([x, y], [_, _, z]) = (columns.cop_m[parameter], columns.force_n[parameter]);
            *per_unit = [x, y, z].map(|part| factor * part);
            for (sum, part) in change.mean.iter_mut().zip(per_unit) {
                *sum += value[parameter] * *part;
            }
        }
        change
    }
}

impl Response {
    /// Log likelihoods of signals, one column each, up to a constant.
    fn log_likelihoods(&self, drawn: &Mat<f64>) -> Vec<f64> {
        let mut off = Mat::from_fn(drawn.nrows(), drawn.ncols(), |i, j| drawn[(i, j)] - self.mean[i]);
        self.factor.whiten_from(0, &mut off);
        let square = |j: usize| off.col_as_slice(j).iter().map(|value| value * value).sum::<f64>();
        (0..off.ncols()).map(|j| -0.5 * square(j) - self.factor.half_log_det()).collect()
    }
}

/// Expected decrease of the entropy of the classes' probabilities, nats. `prior` and `class`: of each explanation.
fn information_nats(prior: &[f64], class: &[usize], responses: &[Response]) -> f64 {
    let before = entropy(&of_classes(class, prior));
    before - expectation(prior, responses, |posterior| entropy(&of_classes(class, posterior)))
}

/// Expectation of a function of the explanations' probabilities after a response that one of them predicts, over drawn
/// responses.
fn expectation(prior: &[f64], responses: &[Response], mut of: impl FnMut(&[f64]) -> f64) -> f64 {
    let size = responses.first().map_or(0, |response| response.mean.len());
    let mut random = Pcg64Mcg::seed_from_u64(SEEDS[2]);
    let mut standard = Mat::zeros(size, RESPONSES);
    for response in 0..RESPONSES {
        standard.col_as_slice_mut(response).iter_mut().for_each(|value| *value = normal(&mut random));
    }
    let mut expected = 0.0;
    for (truth, probability) in responses.iter().zip(prior) {
        let spread = product(truth.factor.lower(), standard.as_ref());
        let drawn = Mat::from_fn(size, RESPONSES, |i, j| truth.mean[i] + spread[(i, j)]);
        let of_each: Vec<Vec<f64>> = responses.iter().map(|one| one.log_likelihoods(&drawn)).collect();
        let of_responses = (0..RESPONSES).map(|response| of_each.iter().map(move |one| one[response]));
        for log_likelihoods in of_responses {
            let log_weights: Vec<f64> = prior
                .iter()
                .zip(log_likelihoods)
                .map(|(prior, log_likelihood)| prior.ln() + log_likelihood / EVIDENCE_TEMPER)
                .collect();
            let total = log_sum_exp(&log_weights);
            let posterior: Vec<f64> = log_weights.iter().map(|weight| (weight - total).exp()).collect();
            expected += probability / RESPONSES as f64 * of(&posterior);
        }
    }
    expected
}

/// Sums of the probabilities of each class, at the index of the class.
fn of_classes(class: &[usize], probabilities: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; probabilities.len()];
    class.iter().zip(probabilities).for_each(|(&class, probability)| sums[class] += probability);
    sums
}

/// Change of the signals by an effect, and per unit of its parameters.
#[derive(Default)]
struct Change {
    mean: [f64; SIGNALS],
    per_unit: [[f64; SIGNALS]; PARAMETERS_MAX],
}

/// Whether an effect grows with the speed of the motion.
fn is_of_motion(effect: Effect) -> bool {
    matches!(effect, Effect::SuitLag | Effect::PlateLowpass | Effect::Inertia)
}

/// Whether an effect has ended before the end of the work.
fn has_ended(candidate: &Candidate, rows: &Rows<'_>) -> bool {
    let Scope::Span([_, to_s]) = candidate.scope else { return false };
    to_s < rows.time_s(rows.len() - 1) - OPEN_END_BLOCKS * rows.session.block_s
}

/// Entropy of probabilities, nats.
fn entropy(probabilities: &[f64]) -> f64 {
    let some = probabilities.iter().filter(|probability| **probability > 0.0);
    -some.map(|probability| probability * probability.ln()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::{Session, Spans};

    fn response(mean: f64) -> Response {
        Response { mean: vec![mean], factor: Factor::of(&Mat::identity(1, 1)).unwrap() }
    }

    #[test]
    fn information_is_between_nothing_and_the_entropy_of_the_prior() {
        let prior = [0.5, 0.3, 0.2];
        let of = |means: [f64; 3], class: &[usize]| information_nats(&prior, class, &means.map(response));
        let same = of([1.0; 3], &[0, 1, 2]);
        assert!(same.abs() < 1e-12, "equal predictions: {same}");
        let all = of([0.0, 30.0, 60.0], &[0, 1, 2]);
        assert!((all - entropy(&prior)).abs() < 1e-6, "{all}");
        // The first two have the same names: only the third counts.
        let names = of([0.0, 30.0, 60.0], &[0, 0, 2]);
        assert!((names - entropy(&[0.8, 0.2])).abs() < 1e-6, "{names}");
        let [near, far] = [1.0, 3.0].map(|apart| of([0.0, apart, 2.0 * apart], &[0, 1, 2]));
        assert!(0.0 < near && near < far, "{near} {far}");
    }

    fn predictor(names: &[&str], outside: [f64; SIGNALS]) -> Predictor {
        Predictor {
            names: names.iter().map(|&name| name.to_owned()).collect(),
            probability: 0.5,
            effects: Vec::new(),
            value: Vec::new(),
            covariance: Mat::new(),
            misfit_scale: 1.0,
            outside,
        }
    }

    fn empty_session(suit_drifts: bool) -> Session {
        Session {
            blocks: Vec::new(),
            mass_kg: 70.0,
            prior_covariance_m2: Vec::new(),
            has_shear: false,
            has_inertia: true,
            suit_drifts,
            block_s: 0.2,
            spans_s: Spans { identify: [0.0; 2], reference: None, work: [0.0; 2], found: true },
            length_s: 0.0,
        }
    }

    /// Covariance of the responses to two measurements after a turn, of an explanation without effects.
    fn covariance(suit_drifts: bool, turn_deg: f64, outside: [f64; SIGNALS]) -> Mat<f64> {
        let session = empty_session(suit_drifts);
        let (rows, predictors) = (Rows::of(&session), [predictor(&[], outside)]);
        let question = Question {
            rows: &rows,
            predictors: &predictors,
            prior: vec![1.0],
            class: vec![0],
            sigma: [0.1; SIGNALS],
        };
        let ask = Ask { turn_deg, ..experiment::empty() };
        let measurements = vec![Measurement::Fast(0); 2];
        let response = question.response(&predictors[0], &Experiment { ask, measurements }).unwrap();
        product(response.factor.lower(), response.factor.lower().transpose())
    }

    #[test]
    fn a_turn_adds_a_stance_offset_that_all_of_its_poses_share() {
        let [present, turned] = [0.0, 90.0].map(|turn_deg| covariance(true, turn_deg, [0.0; SIGNALS]));
        let [_, step_m] = STANCE_M[0];
        for (i, j) in [(0, 0), (0, SIGNALS), (1, 1 + SIGNALS), (0, 1), (2, 2), (2, 2 + SIGNALS)] {
            let is_shared = i % SIGNALS == j % SIGNALS && i % SIGNALS != 2;
            let expected_m2 = if is_shared { 2.0 * step_m * step_m } else { 0.0 };
            let more_m2 = turned[(i, j)] - present[(i, j)];
            assert!((more_m2 - expected_m2).abs() < 1e-12, "{i}, {j}: {more_m2} instead of {expected_m2}");
        }
        // A suit that does not drift has no offset after a step.
        let fixed = covariance(false, 90.0, [0.0; SIGNALS]);
        assert!((fixed[(0, SIGNALS)]).abs() < 1e-12, "{}", fixed[(0, SIGNALS)]);
    }

    #[test]
    fn something_outside_the_catalogue_is_as_large_as_in_the_work() {
        let outside = covariance(true, 0.0, [0.2, 0.0, 3.0]);
        for (signal, size) in [0.2, 0.0, 3.0].into_iter().enumerate() {
            let expected = 0.01 + size * size;
            assert!(
                (outside[(signal, signal)] - expected).abs() < 1e-9,
                "{signal}: {}",
                outside[(signal, signal)]
            );
            assert!(outside[(signal, signal + SIGNALS)].abs() < 1e-12);
        }
    }

    #[test]
    fn an_experiment_decides_where_the_names_become_certain() {
        let session = empty_session(true);
        let rows = Rows::of(&session);
        let decides = |names: [&[&str]; 2]| {
            let predictors = names.map(|names| predictor(names, [0.0; SIGNALS]));
            let question = Question {
                rows: &rows,
                predictors: &predictors,
                prior: vec![0.5; 2],
                class: vec![0, 1],
                sigma: [0.1; SIGNALS],
            };
            [0.0, 3.0, 30.0].map(|apart| question.decides(&[response(0.0), response(apart)]))
        };
        let (load, sway): (&[&str], &[&str]) = (&["hand_load right"], &["hand_load right", "periodic_sway"]);
        let [same, near, far] = decides([load, &["worn_mass RightForearm"]]);
        assert!(same == 0.0 && 0.1 < near && near < 0.9 && far > 0.999_999, "{same} {near} {far}");
        // The load is certain already, and its verdict is `named`.
        assert!(decides([load, sway]).iter().all(|probability| (probability - 1.0).abs() < 1e-9));
    }

    #[test]
    fn half_the_evidence_of_two_equally_probable_responses_is_that_of_a_numerical_integral() {
        // Means ±1, noise 1, evidence divided by 2: posterior 1/(1 + exp(−y)); entropy integrated over N(1, 1).
        let step = 1e-3;
        let expected: f64 = (-8_000..8_000)
            .map(|k| {
                let y = 1.0 + step * f64::from(k);
                let density = (-0.5 * (y - 1.0f64).powi(2)).exp() / (2.0 * std::f64::consts::PI).sqrt();
                let first = 1.0 / (1.0 + (-y).exp());
                step * density * entropy(&[first, 1.0 - first])
            })
            .sum();
        let nats = information_nats(&[0.5, 0.5], &[0, 1], &[response(1.0), response(-1.0)]);
        let expected = std::f64::consts::LN_2 - expected;
        // 64 draws.
        assert!((nats - expected).abs() < 0.1, "{nats} instead of {expected}");
    }
}
