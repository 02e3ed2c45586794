//! The next experiment: the poses, step, standing or motion with the largest expected information about which effects
//! act (D. V. Lindley, Ann. Math. Stat. 27 (1956), 986–1005).
//!
//! Each probable explanation predicts the response: the same Gaussian process that explains the recording, continued by
//! the blocks of the experiment. Responses are drawn from these predictions; the mean decrease of the entropy of the
//! names' probabilities is the expected information.
//!
//! Layers, lowest first: [`experiment`] → [`forecast`] → [`information`] → this file.

mod experiment;
mod forecast;
mod information;

use equipoise_config::model_file::Ask;

use crate::constants::INFORMATION_MIN;
use crate::gram::Gram;
use crate::posterior::{NameSets, Posterior, Predictor};
use crate::rows::Rows;
use experiment::{Choice, Experiment};
use forecast::{Forecast, Prediction, Response};
use information::{expectation, information_nats, of_classes, separation_sigma};

/// The experiment with the largest expected information; `None` if one set of names is certain already, or if no
/// experiment is informative.
pub(crate) fn ask(gram: &Gram<'_>, posterior: &Posterior) -> Option<Ask> {
    if posterior.names.is_decided() {
        return None;
    }
    let choice = Choice::after(gram.rows)?;
    let blocks = gram.rows.blocks.iter().copied().chain(&choice.blocks).collect();
    let all = Rows::from_blocks(gram.rows.session, blocks);
    let forecast = Forecast::of(gram, &all);
    let question = Question::of(posterior.predictors(|explanation| forecast.prediction(explanation)))?;
    let best_of = |experiments: Vec<Experiment>| {
        let rated = experiments.into_iter().filter_map(|one| Some((question.information_nats(&one)?, one)));
        rated.reduce(|best, one| if one.0 > best.0 { one } else { best })
    };
    let mut best = best_of(choice.single.clone())?;
    while let Some(longer) = best_of(choice.with_another_pose(&best.1)) {
        if longer.0 <= best.0 {
            break;
        }
        best = longer;
    }
    let (information_nats, experiment) = best;
    let responses = question.responses(&experiment)?;
    let [one, other] = question.leading();
    (information_nats >= INFORMATION_MIN).then(|| Ask {
        between: question.between(),
        information_nats,
        decides: question.decides(&responses),
        separation_sigma: separation_sigma(&responses[one], &responses[other]),
        ..experiment.ask
    })
}

/// The probable explanations and their predictions.
struct Question {
    predictors: Vec<Predictor<Prediction>>,
    /// Probability of each.
    prior: Vec<f64>,
    /// Of each explanation: the first one with the same names.
    class: Vec<usize>,
}

impl Question {
    /// `None` if there is no prediction.
    fn of(predictors: Vec<Predictor<Prediction>>) -> Option<Question> {
        let first = |one: &Predictor<Prediction>| {
            predictors.iter().position(|other| other.names == one.names).unwrap_or(0)
        };
        let class = predictors.iter().map(first).collect();
        let prior = predictors.iter().map(|one| one.probability).collect();
        (!predictors.is_empty()).then_some(Question { predictors, prior, class })
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
        self.predictors.iter().map(|one| one.prediction.of_blocks(&experiment.measurements)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::Factor;
    use nalgebra::DMatrix;

    #[test]
    fn an_experiment_decides_where_the_names_become_certain() {
        let decides = |names: [&[&str]; 2]| {
            let predictor = |names: &[&str]| Predictor {
                names: names.iter().map(|&name| name.to_owned()).collect(),
                probability: 0.5,
                prediction: Prediction { mean: Vec::new(), covariance: DMatrix::zeros(0, 0) },
            };
            let question = Question::of(names.map(predictor).into()).unwrap();
            let response =
                |mean| Response { mean: vec![mean], factor: Factor::of(&DMatrix::identity(1, 1)).unwrap() };
            [0.0, 3.0, 30.0].map(|apart| question.decides(&[response(0.0), response(apart)]))
        };
        let (load, sway): (&[&str], &[&str]) = (&["hand_load right"], &["hand_load right", "periodic_sway"]);
        let [same, near, far] = decides([load, &["worn_mass RightForearm"]]);
        assert!(same == 0.0 && 0.1 < near && near < 0.9 && far > 0.999_999, "{same} {near} {far}");
        // The load is certain already, and its verdict is `named`.
        assert!(decides([load, sway]).iter().all(|probability| (probability - 1.0).abs() < 1e-9));
    }
}
