//! The next experiment: the poses, step, standing or motion with the largest expected information about which effects
//! act (D. V. Lindley, Ann. Math. Stat. 27 (1956), 986–1005).
//!
//! Each probable explanation predicts the response, with the uncertainty of its parameters, its misfit and the noise.
//! Responses are drawn from these predictions; the mean decrease of the entropy of the names' probabilities is the
//! expected information.

mod experiment;

use equipoise_config::model_file::Ask;
use equipoise_core::effect::{Effect, PARAMETERS_MAX};
use faer::Mat;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use crate::candidate::{Candidate, Scope};
use crate::constants::{
    EVIDENCE_TEMPER, FASTER, INFORMATION_MIN, NAMED_PROBABILITY, OPEN_END_BLOCKS, RESPONSES, SEEDS,
};
use crate::evidence::log_sum_exp;
use crate::explanation::model_error;
use crate::floor::Floor;
use crate::linear::{Factor, product};
use crate::picture::Signal;
use crate::posterior::Predictor;
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
        let rated = experiments.into_iter().filter_map(|one| Some((question.outlook(&one)?, one)));
        rated.reduce(|best, one| if one.0.information_nats > best.0.information_nats { one } else { best })
    };
    let mut best = best_of(experiment::single(rows))?;
    while let Some(longer) = best_of(experiment::with_another_pose(rows, &best.1)) {
        if longer.0.information_nats <= best.0.information_nats {
            break;
        }
        best = longer;
    }
    let (Outlook { information_nats, decides }, experiment) = best;
    let separation_sigma = question.separation_sigma(&question.responses(&experiment)?);
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

/// What is expected of an experiment.
struct Outlook {
    /// Expected information, nats.
    information_nats: f64,
    /// Probability that one set of names is certain afterwards.
    decides: f64,
}

/// Predicted signals of an experiment.
struct Response {
    mean: Vec<f64>,
    factor: Factor,
}

impl<'a> Question<'a> {
    /// `None` if one set of names is certain, or if no explanation could be fitted.
    fn of(rows: &'a Rows<'a>, predictors: &'a [Predictor], floor: &Floor) -> Option<Question<'a>> {
        let first =
            |one: &Predictor| predictors.iter().position(|other| other.names == one.names).unwrap_or(0);
        let question = Question {
            rows,
            predictors,
            prior: predictors.iter().map(|one| one.probability).collect(),
            class: predictors.iter().map(first).collect(),
            sigma: std::array::from_fn(|axis| floor.root_mean_square(axis, |_| true).max(1e-6)),
        };
        let is_open = !predictors.is_empty() && !is_decided(&of_classes(&question.class, &question.prior));
        is_open.then_some(question)
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

    /// What is expected of an experiment; `None` if a prediction is degenerate.
    fn outlook(&self, experiment: &Experiment) -> Option<Outlook> {
        let (information_nats, decides) = information(&self.prior, &self.class, &self.responses(experiment)?);
        Some(Outlook { information_nats, decides })
    }

    /// The prediction of each explanation; `None` if one is degenerate.
    fn responses(&self, experiment: &Experiment) -> Option<Vec<Response>> {
        self.predictors.iter().map(|one| self.response(one, &experiment.measurements)).collect()
    }

    /// Distance of the predictions of the two most probable sets of names, 1-σ of the noise.
    fn separation_sigma(&self, responses: &[Response]) -> f64 {
        let [one, other] = self.leading().map(|index| &responses[index].mean);
        let differences = one.iter().zip(other).enumerate();
        differences.map(|(i, (a, b))| ((a - b) / self.sigma[i % SIGNALS]).powi(2)).sum::<f64>().sqrt()
    }

    /// Predicted signals of all measurements, with the covariance of the parameters, of the misfit and of the noise.
    fn response(&self, predictor: &Predictor, measurements: &[Measurement]) -> Option<Response> {
        let size = SIGNALS * measurements.len();
        let mut mean = vec![0.0; size];
        let mut variance: Vec<f64> = (0..size).map(|i| self.sigma[i % SIGNALS].powi(2)).collect();
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
        let covariance =
            Mat::from_fn(size, size, |i, j| spread[(i, j)] + if i == j { variance[i] } else { 0.0 });
        Some(Response { mean, factor: Factor::of(&covariance)? })
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

/// Expected decrease of the entropy of the classes' probabilities, nats, and the probability that one class is certain
/// afterwards, if one of some explanations predicts the response. `prior` and `class`: of each explanation.
fn information(prior: &[f64], class: &[usize], responses: &[Response]) -> (f64, f64) {
    let size = responses.first().map_or(0, |response| response.mean.len());
    let mut random = Pcg64Mcg::seed_from_u64(SEEDS[2]);
    let mut standard = Mat::zeros(size, RESPONSES);
    for response in 0..RESPONSES {
        standard.col_as_slice_mut(response).iter_mut().for_each(|value| *value = normal(&mut random));
    }
    let (mut information_nats, mut decides) = (entropy(&of_classes(class, prior)), 0.0);
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
            let classes = of_classes(class, &posterior);
            let weight = probability / RESPONSES as f64;
            information_nats -= weight * entropy(&classes);
            decides += weight * f64::from(u8::from(is_decided(&classes)));
        }
    }
    // The weights' sum may exceed 1 by rounding.
    (information_nats, decides.min(1.0))
}

/// Sums of the probabilities of each class, at the index of the class.
fn of_classes(class: &[usize], probabilities: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; probabilities.len()];
    class.iter().zip(probabilities).for_each(|(&class, probability)| sums[class] += probability);
    sums
}

fn is_decided(classes: &[f64]) -> bool {
    classes.iter().any(|probability| *probability >= NAMED_PROBABILITY)
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

    fn response(mean: f64) -> Response {
        Response { mean: vec![mean], factor: Factor::of(&Mat::identity(1, 1)).unwrap() }
    }

    #[test]
    fn information_is_between_nothing_and_the_entropy_of_the_prior() {
        let prior = [0.5, 0.3, 0.2];
        let of = |means: [f64; 3], class: &[usize]| information(&prior, class, &means.map(response));
        let (same, decides) = of([1.0; 3], &[0, 1, 2]);
        assert!(same.abs() < 1e-12 && decides == 0.0, "equal predictions: {same}, {decides}");
        let (all, decides) = of([0.0, 30.0, 60.0], &[0, 1, 2]);
        assert!((all - entropy(&prior)).abs() < 1e-6 && decides > 0.999_999, "{all}, {decides}");
        // The first two have the same names: only the third counts.
        let (names, _) = of([0.0, 30.0, 60.0], &[0, 0, 2]);
        assert!((names - entropy(&[0.8, 0.2])).abs() < 1e-6, "{names}");
        let [near, far] = [1.0, 3.0].map(|apart| of([0.0, apart, 2.0 * apart], &[0, 1, 2]));
        assert!(0.0 < near.0 && near.0 < far.0 && near.1 < far.1 && far.1 < 1.0, "{near:?} {far:?}");
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
        let (nats, _) = information(&[0.5, 0.5], &[0, 1], &[response(1.0), response(-1.0)]);
        let expected = std::f64::consts::LN_2 - expected;
        // 64 draws.
        assert!((nats - expected).abs() < 0.1, "{nats} instead of {expected}");
    }
}
