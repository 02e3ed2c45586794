//! Whitened columns and their inner products; all further inference is small algebra on them.
//!
//! Rows are the centre of pressure, then the force channels, each whitened by its own factor. Directions that count as
//! model error (see [`Gram::marginalise`]) are projected out of all inner products.

use equipoise_core::effect::Columns;
use nalgebra::DMatrix;

use crate::candidate::Candidate;
use crate::linear::{self, dot, inner};
use crate::noise::Noise;
use crate::rows::Rows;

/// A term with whitened columns: a candidate of the catalogue, or a generic term with a description only.
#[derive(Debug, Clone)]
pub(crate) struct Term {
    /// The catalogue candidate, if it is one.
    pub(crate) candidate: Option<Candidate>,
    /// Index of its first column.
    pub(crate) first: usize,
    /// Number of columns.
    pub(crate) count: usize,
    /// Prior mean of the parameters.
    pub(crate) mean: Vec<f64>,
    /// Prior 1-σ.
    pub(crate) sigma: Vec<f64>,
    /// Logarithm of its prior weight among the variants of its name.
    pub(crate) log_prior: f64,
    /// Whether it was derived during the search (refined, or limited to a part of the work) and is not part of every
    /// trial.
    pub(crate) is_derived: bool,
}

impl Term {
    /// The term of a candidate, whose columns are not placed yet.
    fn of(candidate: Candidate) -> Term {
        Term {
            first: 0,
            count: candidate.count(),
            mean: candidate.mean.clone(),
            sigma: candidate.sigma.clone(),
            log_prior: candidate.log_prior,
            candidate: Some(candidate),
            is_derived: false,
        }
    }

    /// A term without candidate, whose columns are not placed yet.
    pub(crate) fn generic(mean: Vec<f64>, sigma: Vec<f64>) -> Term {
        let count = mean.len();
        Term { candidate: None, first: 0, count, mean, sigma, log_prior: 0.0, is_derived: true }
    }

    /// The range of its columns.
    pub(crate) fn columns(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.count
    }

    /// Predicted change at a block with these parameters: centre of pressure x, y (m), vertical force (N).
    fn predicted(&self, rows: &Rows<'_>, block: usize, value: &[f64]) -> [f64; 3] {
        let Some(candidate) = &self.candidate else { return [0.0; 3] };
        let columns = candidate.columns(rows, block);
        let mut sum = [0.0; 3];
        for (k, value) in value.iter().enumerate() {
            sum[0] += value * columns.cop_m[k][0];
            sum[1] += value * columns.cop_m[k][1];
            sum[2] += value * columns.force_n[k][2];
        }
        sum
    }
}

/// The whitened problem.
#[derive(Debug, Clone)]
pub(crate) struct Gram<'a> {
    /// The rows from which it is built.
    pub(crate) rows: &'a Rows<'a>,
    /// The noise model that whitens it.
    pub(crate) noise: &'a Noise,
    /// Whitened residual.
    pub(crate) residual: Vec<f64>,
    /// Whitened columns of all terms.
    pub(crate) columns: Vec<Vec<f64>>,
    /// The terms.
    pub(crate) terms: Vec<Term>,
    /// Directions marginalised as model error.
    pub(crate) marginalised: Vec<Vec<f64>>,
    /// Columns of the errors of the sensors among them, times their 1-σ; independent of the named effects.
    pub(crate) sensor_errors: Vec<Vec<f64>>,
    /// Components along them: of each column, and of the residual.
    along: Vec<Vec<f64>>,
    residual_along: Vec<f64>,
    /// Inner products of columns, full symmetric matrix.
    pub(crate) products: Vec<Vec<f64>>,
    /// Inner products of columns with the residual.
    pub(crate) with_residual: Vec<f64>,
}

impl<'a> Gram<'a> {
    /// Built from all candidates.
    pub(crate) fn of(rows: &'a Rows<'a>, noise: &'a Noise, candidates: Vec<Candidate>) -> Gram<'a> {
        let residual = whitened_residual(rows, noise);
        let mut gram = Gram {
            rows,
            noise,
            residual,
            columns: Vec::new(),
            terms: Vec::new(),
            marginalised: Vec::new(),
            sensor_errors: Vec::new(),
            along: Vec::new(),
            residual_along: Vec::new(),
            products: Vec::new(),
            with_residual: Vec::new(),
        };
        for candidate in candidates {
            let columns = gram.whitened(candidate.count(), |block| candidate.columns(rows, block));
            let term = Term { first: gram.columns.len(), ..Term::of(candidate) };
            gram.terms.push(term);
            gram.columns.extend(columns);
        }
        gram.multiply_all();
        gram
    }

    /// Whitened columns of a function of the block.
    pub(crate) fn whitened(&self, count: usize, of: impl Fn(usize) -> Columns) -> Vec<Vec<f64>> {
        whiten(self.rows, self.noise, count, of)
    }

    /// Adds a derived term; returns its index.
    pub(crate) fn add(&mut self, mut term: Term, columns: Vec<Vec<f64>>) -> usize {
        term.first = self.columns.len();
        term.is_derived = true;
        for column in columns {
            let along: Vec<f64> = self.marginalised.iter().map(|other| dot(&column, other)).collect();
            let others = self.columns.iter().zip(&self.along);
            let mut products: Vec<f64> =
                others.map(|(other, along_other)| dot(other, &column) - dot(along_other, &along)).collect();
            products.push(dot(&column, &column) - dot(&along, &along));
            self.with_residual.push(dot(&column, &self.residual) - dot(&along, &self.residual_along));
            for (row, &product) in self.products.iter_mut().zip(&products) {
                row.push(product);
            }
            self.products.push(products);
            self.columns.push(column);
            self.along.push(along);
        }
        self.terms.push(term);
        self.terms.len() - 1
    }

    /// Adds a candidate.
    pub(crate) fn add_candidate(&mut self, candidate: Candidate) -> usize {
        let columns = self.whitened(candidate.count(), |block| candidate.columns(self.rows, block));
        let term = Term::of(candidate);
        self.add(term, columns)
    }

    /// Removes all terms beyond this number.
    pub(crate) fn truncate(&mut self, terms: usize) {
        self.terms.truncate(terms);
        let columns = self.terms.last().map_or(0, |term| term.first + term.count);
        self.columns.truncate(columns);
        self.along.truncate(columns);
        self.with_residual.truncate(columns);
        self.products.truncate(columns);
        for row in &mut self.products {
            row.truncate(columns);
        }
    }

    /// Marginalises a direction as model error of this 1-σ (per unit of the column): it provides no evidence any more.
    pub(crate) fn marginalise(&mut self, column: &[f64], sigma: f64) {
        let direction = direction(column, sigma, &self.marginalised);
        self.project_out(direction);
    }

    /// The same for an error of the sensors, which belongs to no effect.
    pub(crate) fn marginalise_sensor_error(&mut self, column: &[f64], sigma: f64) {
        self.sensor_errors.push(column.iter().map(|value| sigma * value).collect());
        self.marginalise(column, sigma);
    }

    fn project_out(&mut self, direction: Vec<f64>) {
        let along: Vec<f64> = self.columns.iter().map(|column| dot(column, &direction)).collect();
        let with_residual = dot(&self.residual, &direction);
        self.along.iter_mut().zip(&along).for_each(|(of_column, &value)| of_column.push(value));
        self.residual_along.push(with_residual);
        for (i, row) in self.products.iter_mut().enumerate() {
            for (value, other) in row.iter_mut().zip(&along) {
                *value -= along[i] * other;
            }
            self.with_residual[i] -= along[i] * with_residual;
        }
        self.marginalised.push(direction);
    }

    /// Number of rows of the centre of pressure; those of the forces follow.
    pub(crate) fn cop_rows(&self) -> usize {
        2 * self.rows.len()
    }

    fn multiply_all(&mut self) {
        let matrix = DMatrix::from_fn(self.residual.len(), self.columns.len(), |i, j| self.columns[j][i]);
        let products = inner(&matrix, &matrix);
        let count = self.columns.len();
        self.products = (0..count).map(|i| (0..count).map(|j| products[(i, j)]).collect()).collect();
        self.with_residual = self.columns.iter().map(|column| dot(column, &self.residual)).collect();
        self.along = vec![Vec::new(); count];
    }
}

/// The residual of all channels, whitened.
fn whitened_residual(rows: &Rows<'_>, noise: &Noise) -> Vec<f64> {
    let columns = whiten(rows, noise, 1, |block| {
        let mut columns = Columns::zero(1);
        columns.cop_m[0] = rows.cop_residual_m(block);
        columns.force_n[0] = [0, 1, 2].map(|axis| rows.force_residual_n(block, axis));
        columns
    });
    columns.into_iter().next().unwrap_or_default()
}

/// Whitens columns given block by block; leading zero blocks cost nothing.
pub(crate) fn whiten(
    rows: &Rows<'_>,
    noise: &Noise,
    count: usize,
    of: impl Fn(usize) -> Columns,
) -> Vec<Vec<f64>> {
    let blocks: Vec<Columns> = (0..rows.len()).map(of).collect();
    whiten_each(rows, noise, count, |block, column| {
        (blocks[block].cop_m[column], blocks[block].force_n[column])
    })
}

/// Whitens any number of columns, given by block and column: centre of pressure, m, and force, N.
pub(crate) fn whiten_each(
    rows: &Rows<'_>,
    noise: &Noise,
    count: usize,
    of: impl Fn(usize, usize) -> ([f64; 2], [f64; 3]),
) -> Vec<Vec<f64>> {
    let is_nonzero = |block: usize| {
        (0..count).any(|column| {
            let (cop_m, force_n) = of(block, column);
            cop_m.iter().chain(&force_n).any(|&value| value != 0.0)
        })
    };
    let from = (0..rows.len()).position(is_nonzero).unwrap_or(rows.len());
    let length = rows.len() * (2 + rows.force_axes().len());
    let mut whitened = vec![vec![0.0; length]; count];
    if from == rows.len() {
        return whitened;
    }
    let some = rows.len() - from;
    let mut cop = DMatrix::from_fn(2 * some, count, |row, column| of(from + row / 2, column).0[row % 2]);
    noise.cop.whiten_from(2 * from, &mut cop);
    copy_rows(&mut whitened, 2 * from, &cop);
    for (channel, &axis) in rows.force_axes().iter().enumerate() {
        let mut force = DMatrix::from_fn(some, count, |row, column| of(from + row, column).1[axis]);
        noise.force[channel].whiten_from(from, &mut force);
        copy_rows(&mut whitened, (2 + channel) * rows.len() + from, &force);
    }
    whitened
}

fn copy_rows(whitened: &mut [Vec<f64>], from: usize, columns: &DMatrix<f64>) {
    for (column, into) in whitened.iter_mut().enumerate() {
        into[from..from + columns.nrows()].copy_from_slice(linear::column(columns, column));
    }
}

impl Gram<'_> {
    /// All directions that are projected out if some terms are accepted as well, and the residual minus their prior
    /// means.
    pub(crate) fn directions_given(&self, accepted: &[usize]) -> (Vec<Vec<f64>>, Vec<f64>) {
        let mut directions = self.marginalised.clone();
        let mut residual = self.residual.clone();
        for &index in accepted {
            let term = &self.terms[index];
            for (k, column) in term.columns().enumerate() {
                let column = &self.columns[column];
                residual.iter_mut().zip(column).for_each(|(value, column)| *value -= term.mean[k] * column);
                directions.push(direction(column, term.sigma[k], &directions));
            }
        }
        (directions, residual)
    }

    /// Predicted change at a block by each of some terms with these parameters, m, m, N.
    pub(crate) fn predictions<'b>(
        &'b self,
        terms: &'b [usize],
        mut value: &'b [f64],
        block: usize,
    ) -> impl Iterator<Item = [f64; 3]> + 'b {
        terms.iter().map(move |&term| {
            let term = &self.terms[term];
            let (own, others) = value.split_at(term.count);
            value = others;
            term.predicted(self.rows, block, own)
        })
    }

    /// Log Bayes factor of a candidate that is no term, with some directions projected out.
    pub(crate) fn score_candidate(
        &self,
        candidate: &Candidate,
        directions: &[Vec<f64>],
        residual: &[f64],
    ) -> f64 {
        let columns = self.whitened(candidate.count(), |block| candidate.columns(self.rows, block));
        score(&columns, directions, residual, &candidate.mean, &candidate.sigma)
    }
}

/// Log Bayes factor of whitened columns, with some directions projected out.
pub(crate) fn score(
    columns: &[Vec<f64>],
    directions: &[Vec<f64>],
    residual: &[f64],
    mean: &[f64],
    sigma: &[f64],
) -> f64 {
    let along: Vec<Vec<f64>> =
        columns.iter().map(|column| directions.iter().map(|other| dot(column, other)).collect()).collect();
    let on_residual: Vec<f64> = directions.iter().map(|other| dot(other, residual)).collect();
    let with_residual: Vec<f64> = columns
        .iter()
        .zip(&along)
        .map(|(column, along)| dot(column, residual) - dot(along, &on_residual))
        .collect();
    let of = |i: usize, j: usize| dot(&columns[i], &columns[j]) - dot(&along[i], &along[j]);
    crate::evidence::log_odds(&of, &|i| with_residual[i], mean, sigma)
}

/// The direction to be projected out for a column whose amplitude has a 1-σ uncertainty, given the other directions.
pub(crate) fn direction(column: &[f64], sigma: f64, others: &[Vec<f64>]) -> Vec<f64> {
    let mut direction = column.to_vec();
    let mut own = dot(column, column);
    for other in others {
        let along = dot(column, other);
        own -= along * along;
        direction.iter_mut().zip(other).for_each(|(value, other)| *value -= along * other);
    }
    let scale = 1.0 / (1.0 / (sigma * sigma) + own.max(0.0)).sqrt();
    direction.iter_mut().for_each(|value| *value *= scale);
    direction
}
