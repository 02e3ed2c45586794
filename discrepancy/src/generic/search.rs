//! Greedy search of a library by the evidence, term after term, and the level that it reaches by chance.

use equipoise_core::effect::Columns;
use nalgebra::DMatrix;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::library::Entry;
use crate::constants::{CLEAR_LEAD, DRAWS, SEEDS};
use crate::evidence::{estimate, log_odds, log_sum_exp};
use crate::finding::Generic;
use crate::gram::{Gram, direction, score};
use crate::linear::{column, column_mut, dot, inner};
use crate::trials::normal;

/// A library, whitened.
#[derive(Debug, Clone)]
pub(crate) struct Library {
    entries: Vec<Entry>,
    /// First column of each entry.
    first: Vec<usize>,
    columns: DMatrix<f64>,
}

/// A fitted term of the library.
pub(crate) struct FittedEntry<'a> {
    /// Description and log odds.
    pub(crate) generic: Generic,
    /// Its columns at every block of the work, and whitened.
    pub(crate) columns_at: &'a [Columns],
    pub(crate) columns: Vec<Vec<f64>>,
    /// Prior 1-σ and fitted values of its parameters.
    pub(crate) sigma: &'a [f64],
    pub(crate) value: Vec<f64>,
    /// Deviation from its equation, as [`crate::constants::MODEL_ERROR`].
    pub(crate) model_error: (f64, u32),
}

/// Quantities of every entry once some directions are projected out: products of its columns, products with the
/// residual.
struct Projected {
    products: Vec<Vec<f64>>,
    with_residual: Vec<f64>,
}

impl Library {
    /// Whitens all columns at once.
    pub(super) fn of(gram: &Gram<'_>, entries: Vec<Entry>) -> Library {
        let mut first = Vec::with_capacity(entries.len());
        let mut count = 0;
        for entry in &entries {
            first.push(count);
            count += entry.sigma.len();
        }
        let columns = whitened(gram, &entries, count);
        Library { entries, first, columns }
    }

    /// The best log odds that any entry reaches in [`DRAWS`] draws of white noise.
    pub(super) fn chance_level(&self) -> f64 {
        let mut random = Pcg64Mcg::seed_from_u64(SEEDS[1]);
        let mut noise = DMatrix::zeros(self.columns.nrows(), DRAWS);
        for draw in 0..DRAWS {
            for value in column_mut(&mut noise, draw) {
                *value = normal(&mut random);
            }
        }
        let with_noise = inner(&self.columns, &noise);
        let mut projected = self.projected(&[], &[]);
        let mut best = f64::NEG_INFINITY;
        for draw in 0..DRAWS {
            projected.with_residual.copy_from_slice(column(&with_noise, draw));
            best = (0..self.entries.len()).map(|entry| self.score(&projected, entry)).fold(best, f64::max);
        }
        best
    }

    /// The best terms in addition to the accepted ones, each conditioned on the previous, as long as their gain
    /// suffices.
    pub(super) fn greedy(
        &self,
        gram: &Gram<'_>,
        accepted: &[usize],
        threshold: f64,
        max: usize,
    ) -> Vec<Generic> {
        let (mut directions, residual) = gram.directions_given(accepted);
        let mut projected = self.projected(&directions, &residual);
        let mut accepted_terms = Vec::new();
        while accepted_terms.len() < max {
            let Some((log_odds, index)) =
                self.supported(gram, &projected, (&directions, &residual), threshold).next()
            else {
                break;
            };
            let entry = &self.entries[index];
            accepted_terms.push(Generic { what: entry.what.clone(), log_odds });
            for (k, &sigma) in entry.sigma.iter().enumerate() {
                let column = column(&self.columns, self.first[index] + k);
                directions.push(direction(column, sigma, &directions));
                self.project_out(&mut projected, &directions[directions.len() - 1..], &residual);
            }
        }
        accepted_terms
    }

    /// Entries whose log odds exceed a threshold, best first; an error of the suit must show in the centre of pressure.
    fn supported<'a>(
        &'a self,
        gram: &'a Gram<'_>,
        projected: &Projected,
        (directions, residual): (&'a [Vec<f64>], &'a [f64]),
        threshold: f64,
    ) -> impl Iterator<Item = (f64, usize)> + 'a {
        let mut scores: Vec<(f64, usize)> = (0..self.entries.len())
            .map(|entry| (self.score(projected, entry), entry))
            .filter(|(log_odds, _)| *log_odds > threshold)
            .collect();
        scores.sort_by(|a, b| b.0.total_cmp(&a.0));
        scores.into_iter().filter(move |&(_, index)| {
            !self.entries[index].is_suit_error
                || self.log_odds_by_cop(gram, index, directions, residual) > CLEAR_LEAD
        })
    }

    /// The best term next to some accepted ones, fitted, and the mean evidence of all terms over its own, as a logarithm.
    /// Each is equally probable, and log evidence is divided by `temper`. A term without evidence counts as zero.
    pub(crate) fn best(
        &self,
        gram: &Gram<'_>,
        accepted: &[usize],
        temper: f64,
    ) -> Option<(FittedEntry<'_>, f64)> {
        let (directions, residual) = gram.directions_given(accepted);
        let projected = self.projected(&directions, &residual);
        let supported: Vec<(f64, usize)> =
            self.supported(gram, &projected, (&directions, &residual), 0.0).collect();
        let &(best, index) = supported.first()?;
        let relative: Vec<f64> = supported.iter().map(|(log_odds, _)| (log_odds - best) / temper).collect();
        let log_mean = log_sum_exp(&relative) - (self.entries.len() as f64).ln();
        let (entry, first) = (&self.entries[index], self.first[index]);
        let (sigma, products) = (&entry.sigma, &projected.products[index]);
        let fitted = estimate(
            &|i, j| products[i * sigma.len() + j],
            &|i| projected.with_residual[first + i],
            &vec![0.0; sigma.len()],
            sigma,
        )?;
        let columns = (first..first + sigma.len()).map(|k| column(&self.columns, k).to_vec()).collect();
        let generic = Generic { what: entry.what.clone(), log_odds: best };
        let (columns_at, model_error) = (&*entry.columns, entry.model_error);
        let fitted = FittedEntry { generic, columns_at, columns, sigma, value: fitted.value, model_error };
        Some((fitted, log_mean))
    }

    fn score(&self, projected: &Projected, entry: usize) -> f64 {
        let (first, sigma) = (self.first[entry], &self.entries[entry].sigma);
        let (products, count) = (&projected.products[entry], sigma.len());
        let mean = [0.0; equipoise_core::effect::PARAMETERS_MAX];
        log_odds(
            &|i, j| products[i * count + j],
            &|i| projected.with_residual[first + i],
            &mean[..count],
            sigma,
        )
    }

    /// Log odds of an entry from the rows of the centre of pressure.
    fn log_odds_by_cop(
        &self,
        gram: &Gram<'_>,
        entry: usize,
        directions: &[Vec<f64>],
        residual: &[f64],
    ) -> f64 {
        let (rows, sigma) = (gram.cop_rows(), &self.entries[entry].sigma);
        let part = |column: &[f64]| column[..rows].to_vec();
        let columns: Vec<Vec<f64>> =
            (0..sigma.len()).map(|k| part(column(&self.columns, self.first[entry] + k))).collect();
        let directions: Vec<Vec<f64>> = directions.iter().map(|direction| part(direction)).collect();
        score(&columns, &directions, &residual[..rows], &vec![0.0; sigma.len()], sigma)
    }

    fn projected(&self, directions: &[Vec<f64>], residual: &[f64]) -> Projected {
        let column = |index: usize| column(&self.columns, index);
        let products = self.entries.iter().zip(&self.first).map(|(entry, &first)| {
            let count = entry.sigma.len();
            (0..count * count).map(|k| dot(column(first + k / count), column(first + k % count))).collect()
        });
        let with_residual = (0..self.columns.ncols()).map(|index| dot(column(index), residual));
        let mut projected =
            Projected { products: products.collect(), with_residual: with_residual.collect() };
        self.project_out(&mut projected, directions, residual);
        projected
    }

    fn project_out(&self, projected: &mut Projected, directions: &[Vec<f64>], residual: &[f64]) {
        let matrix = DMatrix::from_fn(self.columns.nrows(), directions.len(), |i, j| directions[j][i]);
        let along = inner(&matrix, &self.columns);
        let on_residual: Vec<f64> = directions.iter().map(|direction| dot(direction, residual)).collect();
        for (entry, products) in projected.products.iter_mut().enumerate() {
            let (first, count) = (self.first[entry], self.entries[entry].sigma.len());
            for (k, product) in products.iter_mut().enumerate() {
                let [i, j] = [first + k / count, first + k % count];
                *product -= dot(column(&along, i), column(&along, j));
            }
        }
        for (index, product) in projected.with_residual.iter_mut().enumerate() {
            *product -= dot(column(&along, index), &on_residual);
        }
    }
}

/// All columns of all entries, channel by channel; zero before the work.
fn whitened(gram: &Gram<'_>, entries: &[Entry], count: usize) -> DMatrix<f64> {
    let rows = gram.rows;
    let (from, work) = (rows.work_from, rows.len() - rows.work_from);
    let places: Vec<(usize, usize)> =
        (0..entries.len()).flat_map(|e| (0..entries[e].sigma.len()).map(move |k| (e, k))).collect();
    let at = |column: usize, block: usize| (&entries[places[column].0].columns[block], places[column].1);
    let mut all = DMatrix::zeros(gram.cop_rows() + rows.force_axes().len() * rows.len(), count);
    let mut cop = DMatrix::from_fn(2 * work, count, |row, column| {
        let (columns, k) = at(column, row / 2);
        columns.cop_m[k][row % 2]
    });
    gram.noise.cop.whiten_from(2 * from, &mut cop);
    all.view_mut((2 * from, 0), (2 * work, count)).copy_from(&cop);
    for (channel, &axis) in rows.force_axes().iter().enumerate() {
        let mut force = DMatrix::from_fn(work, count, |row, column| {
            let (columns, k) = at(column, row);
            columns.force_n[k][axis]
        });
        gram.noise.force[channel].whiten_from(from, &mut force);
        let first = gram.cop_rows() + channel * rows.len() + from;
        all.view_mut((first, 0), (work, count)).copy_from(&force);
    }
    all
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::Side;
    use equipoise_core::effect::{Effect, Place};

    use super::*;
    use crate::generic::library;
    use crate::noise::Noise;
    use crate::rows::Rows;
    use crate::support::{END_S, REFERENCE_S, clean, hide};

    #[test]
    fn duplicates_of_the_terms_share_their_prior() {
        let mut session = clean(5);
        let push_n = [10.0, 0.0, 25.0];
        hide(&mut session, Effect::HandContact, Place::Hand(Side::Right), &push_n, [REFERENCE_S, END_S]);
        let all = Rows::of(&session);
        let rows = all.subset(&(0..all.len()).step_by(5).collect::<Vec<usize>>());
        let noise = Noise::fit(&rows).unwrap();
        let gram = Gram::of(&rows, &noise, Vec::new());
        let entries = library::all(&rows);
        let of = |entries: Vec<Entry>| {
            let library = Library::of(&gram, entries);
            let (best, log_mean) = library.best(&gram, &[], 2.0).unwrap();
            (best.generic.log_odds, log_mean)
        };
        let (log_odds, log_mean) = of(entries.clone());
        let tripled = of([entries.clone(), entries.clone(), entries.clone()].concat());
        assert!(log_odds > 20.0, "{log_odds}");
        assert!((tripled.0 - log_odds).abs() < 1e-9 && (tripled.1 - log_mean).abs() < 1e-9, "{tripled:?}");
        // Between the best term alone and all terms as good as it.
        assert!(-(entries.len() as f64).ln() <= log_mean && log_mean < 0.0, "{log_mean}");
    }
}
