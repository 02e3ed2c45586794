//! Signals of further blocks as each explanation predicts them: a normal distribution, conditioned on the recording.

use nalgebra::DMatrix;

use crate::candidate::{Candidate, Scope};
use crate::constants::OPEN_END_BLOCKS;
use crate::explanation::{Explanation, Outside, model_error};
use crate::gram::Gram;
use crate::linear::{Factor, dot, inner, outer, product};
use crate::noise::Continuation;
use crate::noise::cop::pose_correlation;
use crate::picture::Signal;
use crate::rows::Rows;

/// Number of signals of a block: centre of pressure x, y (m), vertical force (N).
pub(super) const SIGNALS: usize = Signal::ALL.len();

/// Predicted signals of some blocks, block by block.
#[derive(Debug, Clone)]
pub(super) struct Prediction {
    /// Mean of measured minus predicted without effects.
    pub(super) mean: Vec<f64>,
    /// Covariance.
    pub(super) covariance: DMatrix<f64>,
}

/// Predicted signals of an experiment.
#[derive(Debug)]
pub(super) struct Response {
    pub(super) mean: Vec<f64>,
    pub(super) factor: Factor,
}

/// The recording's blocks and the further ones, and the noise of these.
pub(super) struct Forecast<'a> {
    gram: &'a Gram<'a>,
    all: &'a Rows<'a>,
    noise: [Continuation; 2],
}

impl<'a> Forecast<'a> {
    /// Of the blocks of `all` beyond those of a Gram matrix, which are its first.
    pub(super) fn of(gram: &'a Gram<'a>, all: &'a Rows<'a>) -> Forecast<'a> {
        Forecast { gram, all, noise: gram.noise.continuation(all) }
    }

    /// The prediction of an explanation; `None` if it cannot be fitted.
    ///
    /// With whitened residual r, columns W and directions D of misfit of the recording, columns T of the further blocks,
    /// and noise of these with covariance B with the whitened rows and S given these: the projection P = I − DDᵀ leaves
    /// the mean Tθ + BP(r − Wθ) and the covariance S + BDDᵀBᵀ + JΘJᵀ, J = T − BPW, of parameters θ with covariance Θ.
    pub(super) fn prediction(&self, explanation: &Explanation) -> Option<Prediction> {
        let (given, terms) = explanation.condition(self.gram);
        let (value, covariance) =
            if terms.is_empty() { (Vec::new(), DMatrix::zeros(0, 0)) } else { given.posterior(&terms)? };
        let columns: Vec<&Vec<f64>> =
            given.columns_of(&terms).into_iter().map(|column| &given.columns[column]).collect();
        let mut residual = given.residual.clone();
        for (column, value) in columns.iter().zip(&value) {
            residual.iter_mut().zip(*column).for_each(|(rest, column)| *rest -= value * column);
        }
        let mut whitened = vec![projected(&residual, &given.marginalised)];
        whitened.extend(columns.iter().map(|column| projected(column, &given.marginalised)));
        whitened.extend(given.marginalised.iter().cloned());
        let continued = self.continued(&whitened);
        let effects = self.effects(explanation, &value);
        let count = value.len();
        let size = continued.nrows();
        let own = DMatrix::from_fn(size, count, |row, k| effects.columns[(row, k)] - continued[(row, 1 + k)]);
        let misfit = continued.columns_range(1 + count..).into_owned();
        let mut sum = self.noise_covariance();
        sum += outer(&misfit, &misfit);
        sum += outer(&product(&own, &covariance), &own);
        for row in 0..size {
            sum[(row, row)] += effects.variance[row];
        }
        if let Some(outside) = &explanation.outside {
            sum += self.outside_covariance(outside);
        }
        let mean = (0..size).map(|row| effects.mean[row] + continued[(row, 0)]).collect();
        Some(Prediction { mean, covariance: sum })
    }

    /// Number of blocks of the recording, and of further ones.
    fn counts(&self) -> [usize; 2] {
        let before = self.gram.rows.len();
        [before, self.all.len() - before]
    }

    /// Whitened columns of the recording, continued by the noise's covariance: a row for each signal.
    fn continued(&self, whitened: &[Vec<f64>]) -> DMatrix<f64> {
        let [before, further] = self.counts();
        let of = |channel: usize, from: usize, rows: usize| {
            let part = DMatrix::from_fn(rows, whitened.len(), |row, column| whitened[column][from + row]);
            inner(&self.noise[channel].with_whitened, &part)
        };
        let (cop, vertical) = (of(0, 0, 2 * before), of(1, 2 * before, before));
        DMatrix::from_fn(SIGNALS * further, whitened.len(), |row, column| {
            let (block, signal) = (row / SIGNALS, row % SIGNALS);
            if signal < 2 { cop[(2 * block + signal, column)] } else { vertical[(block, column)] }
        })
    }

    fn noise_covariance(&self) -> DMatrix<f64> {
        let [_, further] = self.counts();
        let [cop, vertical] = self.noise.each_ref().map(|noise| &noise.covariance);
        DMatrix::from_fn(SIGNALS * further, SIGNALS * further, |i, j| {
            match (i / SIGNALS, i % SIGNALS, j / SIGNALS, j % SIGNALS) {
                (one, a, other, b) if a < 2 && b < 2 => cop[(2 * one + a, 2 * other + b)],
                (one, 2, other, 2) => vertical[(one, other)],
                _ => 0.0,
            }
        })
    }

    /// Contribution of the effects of an explanation to the further blocks, with these parameters.
    fn effects(&self, explanation: &Explanation, value: &[f64]) -> Contribution {
        let [before, further] = self.counts();
        let size = SIGNALS * further;
        let mut sum = Contribution {
            mean: vec![0.0; size],
            columns: DMatrix::zeros(size, value.len()),
            variance: vec![0.0; size],
        };
        let mut first = 0;
        for candidate in
            explanation.members.iter().map(|member| continuing(&member.candidate, self.all, before))
        {
            let misfit = explanation.misfit_scale * model_error(candidate.effect).0;
            for row in 0..size {
                let columns = candidate.columns(self.all, before + row / SIGNALS);
                let mut own = 0.0;
                for parameter in 0..candidate.count() {
                    let per_unit = match row % SIGNALS {
                        axis @ 0..2 => columns.cop_m[parameter][axis],
                        _ => columns.force_n[parameter][2],
                    };
                    sum.columns[(row, first + parameter)] = per_unit;
                    own += value[first + parameter] * per_unit;
                }
                sum.mean[row] += own;
                sum.variance[row] += (misfit * own).powi(2);
            }
            first += candidate.count();
        }
        sum
    }

    /// Covariance of what is outside the catalogue: each signal is an unknown function of the pose, as large as in the work.
    fn outside_covariance(&self, outside: &Outside) -> DMatrix<f64> {
        let [before, further] = self.counts();
        let alike = pose_correlation(&self.all.blocks[before..]);
        DMatrix::from_fn(SIGNALS * further, SIGNALS * further, |i, j| {
            let is_same = i % SIGNALS == j % SIGNALS;
            let size = outside.size[i % SIGNALS];
            if is_same { size * size * alike[(i / SIGNALS, j / SIGNALS)] } else { 0.0 }
        })
    }
}

/// Contribution of effects to some signals: mean, per unit of each parameter (0 of a term outside the catalogue), and
/// variance of each signal by misfit.
struct Contribution {
    mean: Vec<f64>,
    columns: DMatrix<f64>,
    variance: Vec<f64>,
}

impl Prediction {
    /// Of some blocks; `None` if it is degenerate.
    pub(super) fn of_blocks(&self, blocks: &[usize]) -> Option<Response> {
        let rows: Vec<usize> = blocks
            .iter()
            .flat_map(|block| (0..SIGNALS).map(move |signal| SIGNALS * block + signal))
            .collect();
        let covariance = DMatrix::from_fn(rows.len(), rows.len(), |i, j| self.covariance[(rows[i], rows[j])]);
        let mean = rows.iter().map(|&row| self.mean[row]).collect();
        Some(Response { mean, factor: Factor::of(&covariance)? })
    }
}

/// The same effect after the recording as at its end: one that lasts to the end continues.
fn continuing(candidate: &Candidate, all: &Rows<'_>, before: usize) -> Candidate {
    let mut candidate = candidate.clone();
    if let Scope::Span([_, to_s]) = &mut candidate.scope
        && *to_s >= all.time_s(before - 1) - OPEN_END_BLOCKS * all.session.block_s
    {
        *to_s = f64::INFINITY;
    }
    candidate
}

/// A column without its components along some directions.
fn projected(column: &[f64], directions: &[Vec<f64>]) -> Vec<f64> {
    let mut rest = column.to_vec();
    for direction in directions {
        let along = dot(column, direction);
        rest.iter_mut().zip(direction).for_each(|(rest, direction)| *rest -= along * direction);
    }
    rest
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::Side;
    use equipoise_core::effect::{Effect, Place};

    use super::*;
    use crate::ask::experiment::Choice;
    use crate::block::LAGS_S;
    use crate::constants::STANCE_M;
    use crate::explanation::Member;
    use crate::noise::Noise;
    use crate::session::Session;
    use crate::support::{END_S, REFERENCE_S, clean, hide};

    /// Every fifth block of a session.
    fn some(session: &Session) -> Rows<'_> {
        let rows = Rows::of(session);
        rows.subset(&(0..rows.len()).step_by(5).collect::<Vec<usize>>())
    }

    /// Explanation by one effect.
    fn of_effect(gram: &Gram<'_>, effect: Effect, place: Place, shape: f64, value: f64) -> Explanation {
        let candidate = Candidate::new(effect, place, shape, Scope::Work);
        let mut values = vec![0.0; candidate.count()];
        values[0] = value;
        let member = Member::new(gram, candidate, values, 0.0);
        Explanation::of(gram, vec![member], None).unwrap()
    }

    /// Squared distance of what was measured in the further blocks from a prediction, over the number of signals.
    fn distance(prediction: &Prediction, all: &Rows<'_>, before: usize) -> f64 {
        let further = all.len() - before;
        let Response { mean, factor } = prediction.of_blocks(&(0..further).collect::<Vec<usize>>()).unwrap();
        let mut off = DMatrix::from_fn(mean.len(), 1, |row, _| {
            let ([x, y], z) =
                (all.cop_residual_m(before + row / SIGNALS), all.force_residual_n(before + row / SIGNALS, 2));
            [x, y, z][row % SIGNALS] - mean[row]
        });
        factor.whiten_from(0, &mut off);
        off.norm_squared() / mean.len() as f64
    }

    #[test]
    fn the_rest_of_a_recording_is_predicted_from_its_beginning() {
        let hand = Place::Hand(Side::Right);
        let mut session = clean(5);
        hide(&mut session, Effect::HandLoad, hand, &[1.0], [REFERENCE_S, END_S]);
        let all = some(&session);
        let before = (all.work_from + all.len()) / 2;
        let rows = all.subset(&(0..before).collect::<Vec<usize>>());
        let noise = Noise::fit(&rows).unwrap();
        let gram = Gram::of(&rows, &noise, Vec::new());
        let forecast = Forecast::of(&gram, &all);
        let load = of_effect(&gram, Effect::HandLoad, hand, 0.0, 1.0);
        let [right, none] = [&load, &Explanation::NONE]
            .map(|explanation| distance(&forecast.prediction(explanation).unwrap(), &all, before));
        // The prior of the noise is wider than that of these simple sessions.
        assert!((0.1..1.5).contains(&right), "{right}");
        assert!(none > 2.0 * right, "{none} without the load, {right} with it");
    }

    #[test]
    fn each_step_adds_a_stance_offset_that_all_later_blocks_share() {
        let session = clean(5);
        let rows = some(&session);
        let (noise, choice) = (Noise::fit(&rows).unwrap(), Choice::after(&rows).unwrap());
        let gram = Gram::of(&rows, &noise, Vec::new());
        let covariance = |steps: u64| {
            let mut further = choice.blocks[..2].to_vec();
            further.iter_mut().for_each(|block| block.stance = 1 + steps);
            let all = Rows::from_blocks(&session, rows.blocks.iter().copied().chain(&further).collect());
            Forecast::of(&gram, &all).prediction(&Explanation::NONE).unwrap().covariance
        };
        let more = covariance(2) - covariance(0);
        let [[_, step_m], _] = STANCE_M;
        for (i, j) in [(0, 0), (0, SIGNALS), (1, 1 + SIGNALS), (0, 1), (2, 2), (2, 2 + SIGNALS)] {
            let is_shared = i % SIGNALS == j % SIGNALS && i % SIGNALS != 2;
            let expected_m2 = if is_shared { 2.0 * step_m * step_m } else { 0.0 };
            assert!((more[(i, j)] - expected_m2).abs() < 1e-12, "{i}, {j}: {} m²", more[(i, j)]);
        }
    }

    #[test]
    fn fast_motion_has_the_effect_and_the_noise_of_the_fastest_motion_of_the_work() {
        let mut session = clean(5);
        for block in &mut session.blocks {
            let velocity = block.com_velocity_m_per_s;
            for (change, lag_s) in block.by_lag.iter_mut().zip(LAGS_S) {
                change.cop_m = [0, 1].map(|axis| -lag_s * velocity[axis]);
            }
        }
        let rows = some(&session);
        let (noise, choice) = (Noise::fit(&rows).unwrap(), Choice::after(&rows).unwrap());
        let gram = Gram::of(&rows, &noise, Vec::new());
        let all = Rows::from_blocks(&session, rows.blocks.iter().copied().chain(&choice.blocks).collect());
        let forecast = Forecast::of(&gram, &all);
        let of = |fast: bool| &choice.single.iter().find(|one| one.ask.fast == fast).unwrap().measurements;
        let lag = of_effect(&gram, Effect::SuitLag, Place::Whole, 0.05, 1.0);
        let contribution = forecast.effects(&lag, &[1.0]);
        let none = forecast.prediction(&Explanation::NONE).unwrap();
        for &block in of(true) {
            let expected_m = -0.05 * choice.blocks[block].com_velocity_m_per_s[0];
            let mean_m = contribution.mean[SIGNALS * block];
            assert!((mean_m - expected_m).abs() < 1e-9, "{mean_m} instead of {expected_m}");
            let [moving, at_rest] = [block, of(false)[0]]
                .map(|block| none.covariance[(SIGNALS * block + 2, SIGNALS * block + 2)]);
            assert!(moving > 1.5 * at_rest, "vertical force: {moving} N², at rest {at_rest}");
        }
    }

    #[test]
    fn something_outside_the_catalogue_is_as_large_as_in_the_work_and_alike_in_like_poses() {
        let session = clean(5);
        let rows = some(&session);
        let (noise, choice) = (Noise::fit(&rows).unwrap(), Choice::after(&rows).unwrap());
        let gram = Gram::of(&rows, &noise, Vec::new());
        let all = Rows::from_blocks(&session, rows.blocks.iter().copied().chain(&choice.blocks).collect());
        let forecast = Forecast::of(&gram, &all);
        let mut spring = Outside::named("a spring");
        spring.size = [0.2, 0.0, 3.0];
        let outside = Explanation { outside: Some(spring), ..Explanation::NONE };
        let [with, without] =
            [&outside, &Explanation::NONE].map(|one| forecast.prediction(one).unwrap().covariance);
        let more = |one: usize, other: usize| with[(one, other)] - without[(one, other)];
        // Two measurements of straight standing, and one of another pose.
        let last = choice.blocks.len() - 1;
        for (signal, size) in [0.2, 0.0, 3.0_f64].into_iter().enumerate() {
            let [own, same, other] = [0, 1, last].map(|block| more(signal, signal + SIGNALS * block));
            assert!((own - size * size).abs() < 1e-9 && (same - own).abs() < 1e-9, "{signal}: {own} {same}");
            assert!(size == 0.0 || (0.1 * own < other && other < 0.99 * own), "{signal}: {other}");
        }
        assert!(more(0, 2).abs() < 1e-12 && more(2, SIGNALS).abs() < 1e-12);
    }

    #[test]
    fn what_is_outside_the_catalogue_is_not_continued_as_noise() {
        let hand = Place::Hand(Side::Right);
        let mut session = clean(5);
        hide(&mut session, Effect::HandContact, hand, &[0.0, 0.0, 40.0], [REFERENCE_S, END_S]);
        let rows = some(&session);
        let (noise, choice) = (Noise::fit(&rows).unwrap(), Choice::after(&rows).unwrap());
        let gram = Gram::of(&rows, &noise, Vec::new());
        let all = Rows::from_blocks(&session, rows.blocks.iter().copied().chain(&choice.blocks).collect());
        let forecast = Forecast::of(&gram, &all);
        let library = crate::generic::library(&gram);
        let (force, log_mean) = library.best(&gram, &[], 2.0).unwrap();
        let force = Explanation::of(&gram, Vec::new(), Some(Outside::new(&gram, force, log_mean))).unwrap();
        let [with, without] = [&force.without_columns(), &Explanation::NONE]
            .map(|one| forecast.prediction(one).unwrap().mean[2].abs());
        assert!(without > 2.0 && with < 0.3 * without, "{with} N, {without} N without the term");
    }
}
