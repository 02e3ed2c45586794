//! Expected information of a response about which explanation is true.

use nalgebra::DMatrix;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::forecast::Response;
use crate::constants::{EVIDENCE_TEMPER, RESPONSES, SEEDS};
use crate::evidence::log_sum_exp;
use crate::linear::{Factor, column, column_mut, dot, outer, product};
use crate::trials::normal;

impl Response {
    /// Log likelihoods of signals, one column each, up to a constant.
    fn log_likelihoods(&self, drawn: &DMatrix<f64>) -> Vec<f64> {
        let mut off = DMatrix::from_fn(drawn.nrows(), drawn.ncols(), |i, j| drawn[(i, j)] - self.mean[i]);
        self.factor.whiten_from(0, &mut off);
        let square = |j: usize| column(&off, j).iter().map(|value| value * value).sum::<f64>();
        (0..off.ncols()).map(|j| -0.5 * square(j) - self.factor.half_log_det()).collect()
    }
}

/// Expected decrease of the entropy of the classes' probabilities, nats. `prior` and `class`: of each explanation.
pub(super) fn information_nats(prior: &[f64], class: &[usize], responses: &[Response]) -> f64 {
    let before = entropy(&of_classes(class, prior));
    before - expectation(prior, responses, |posterior| entropy(&of_classes(class, posterior)))
}

/// Expectation of a function of the explanations' probabilities after a response that one of them predicts, over drawn
/// responses.
pub(super) fn expectation(prior: &[f64], responses: &[Response], mut of: impl FnMut(&[f64]) -> f64) -> f64 {
    let size = responses.first().map_or(0, |response| response.mean.len());
    let mut random = Pcg64Mcg::seed_from_u64(SEEDS[2]);
    let mut standard = DMatrix::zeros(size, RESPONSES);
    for response in 0..RESPONSES {
        column_mut(&mut standard, response).iter_mut().for_each(|value| *value = normal(&mut random));
    }
    let mut expected = 0.0;
    for (truth, probability) in responses.iter().zip(prior) {
        let spread = product(truth.factor.lower(), &standard);
        let drawn = DMatrix::from_fn(size, RESPONSES, |i, j| truth.mean[i] + spread[(i, j)]);
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
pub(super) fn of_classes(class: &[usize], probabilities: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; probabilities.len()];
    class.iter().zip(probabilities).for_each(|(&class, probability)| sums[class] += probability);
    sums
}

/// Separation of two normal predictions, σ: √8 times the root of the Bhattacharyya distance. For equal covariances this
/// is the distance of the means in units of their σ (A. Bhattacharyya, Bull. Calcutta Math. Soc. 35 (1943), 99–109).
/// What both leave open to the same extent (noise, parameters, something outside the catalogue) separates nothing.
pub(super) fn separation_sigma(one: &Response, other: &Response) -> f64 {
    let [first, second] = [one, other].map(|one| outer(one.factor.lower(), one.factor.lower()));
    let Some(middle) = Factor::of(&(0.5 * (first + second))) else { return 0.0 };
    let mut apart = DMatrix::from_fn(one.mean.len(), 1, |i, _| one.mean[i] - other.mean[i]);
    middle.whiten_from(0, &mut apart);
    let by_mean = dot(column(&apart, 0), column(&apart, 0));
    let by_spread = middle.half_log_det() - 0.5 * (one.factor.half_log_det() + other.factor.half_log_det());
    (by_mean + 8.0 * by_spread).max(0.0).sqrt()
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
        with_variance(mean, 1.0)
    }

    fn with_variance(mean: f64, variance: f64) -> Response {
        Response { mean: vec![mean], factor: Factor::of(&DMatrix::from_fn(1, 1, |_, _| variance)).unwrap() }
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

    #[test]
    fn predictions_are_separated_by_what_they_do_not_share() {
        let is = |one: &Response, other: &Response, expected: f64| {
            let separation = separation_sigma(one, other);
            let off = separation * separation - expected * expected;
            assert!(off.abs() < 1e-9, "{separation} instead of {expected}");
        };
        is(&response(0.0), &response(3.0), 3.0);
        // The same unknown of 2 in both is noise of both; it hides the means, and separates nothing by itself.
        is(&with_variance(0.0, 5.0), &with_variance(3.0, 5.0), 3.0 / 5.0_f64.sqrt());
        is(&with_variance(0.0, 5.0), &with_variance(0.0, 5.0), 0.0);
        // In one of them only, it separates by the spread: 2 ln(3²/5).
        is(&with_variance(0.0, 5.0), &response(0.0), (2.0 * 1.8_f64.ln()).sqrt());
    }
}
