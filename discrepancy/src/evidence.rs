//! Evidence of terms and their parameters, in closed form from the inner products.

use nalgebra::DMatrix;

use crate::gram::{Gram, Term};
use crate::linear::Factor;

/// Parameters of some terms, fitted together.
#[derive(Debug, Clone)]
pub(crate) struct Estimate {
    /// Values of all terms in sequence.
    pub(crate) value: Vec<f64>,
    /// 1-σ of each.
    pub(crate) sigma: Vec<f64>,
}

impl Estimate {
    fn of((value, covariance): (Vec<f64>, DMatrix<f64>)) -> Estimate {
        let sigma = (0..value.len()).map(|i| covariance[(i, i)].max(0.0).sqrt()).collect();
        Estimate { value, sigma }
    }
}

/// Inner products conditioned on the accepted terms.
#[derive(Debug, Clone)]
pub(crate) struct Conditioned {
    /// As [`Gram::products`].
    pub(crate) products: Vec<Vec<f64>>,
    /// As [`Gram::with_residual`].
    pub(crate) with_residual: Vec<f64>,
}

impl Gram<'_> {
    /// Parameters of some terms, fitted together.
    pub(crate) fn estimate(&self, terms: &[usize]) -> Option<Estimate> {
        self.posterior(terms).map(Estimate::of)
    }

    /// The same as mean and covariance.
    pub(crate) fn posterior(&self, terms: &[usize]) -> Option<(Vec<f64>, DMatrix<f64>)> {
        let columns = self.columns_of(terms);
        let (mean, sigma) = self.priors(terms);
        posterior(
            &|i, j| self.products[columns[i]][columns[j]],
            &|i| self.with_residual[columns[i]],
            &mean,
            &sigma,
        )
    }

    /// The inner products, conditioned on some terms.
    pub(crate) fn conditioned_on(&self, terms: &[usize]) -> Conditioned {
        let mut products = self.products.clone();
        let mut with_residual = self.with_residual.clone();
        for &term in terms {
            let term = &self.terms[term];
            for (k, column) in term.columns().enumerate() {
                let row = products[column].clone();
                let rest = with_residual[column] - row[column] * term.mean[k];
                let scale = 1.0 / (1.0 / (term.sigma[k] * term.sigma[k]) + row[column]);
                for (i, line) in products.iter_mut().enumerate() {
                    with_residual[i] -= row[i] * (term.mean[k] + rest * scale);
                    let along = row[i] * scale;
                    line.iter_mut().zip(&row).for_each(|(value, other)| *value -= along * other);
                }
            }
        }
        Conditioned { products, with_residual }
    }

    /// All columns of some terms, in order.
    pub(crate) fn columns_of(&self, terms: &[usize]) -> Vec<usize> {
        terms.iter().flat_map(|&term| self.terms[term].columns()).collect()
    }

    /// Prior means of some terms' parameters, and their 1-σ.
    pub(crate) fn priors(&self, terms: &[usize]) -> (Vec<f64>, Vec<f64>) {
        let of =
            |pick: fn(&Term) -> &Vec<f64>| terms.iter().flat_map(|&t| pick(&self.terms[t]).clone()).collect();
        (of(|term| &term.mean), of(|term| &term.sigma))
    }
}

impl Conditioned {
    /// Log Bayes factor of one additional term.
    pub(crate) fn log_odds(&self, term: &Term) -> f64 {
        let first = term.first;
        log_odds(
            &|i, j| self.products[first + i][first + j],
            &|i| self.with_residual[first + i],
            &term.mean,
            &term.sigma,
        )
    }
}

/// Log Bayes factor of `θ ~ N(mean, sigma²)` against `θ = 0`, from inner products: with `h = with_residual − G mean`,
/// `h·mean + ½ meanᵀ G mean + ½ hᵀ A⁻¹ h − ½ ln det(A diag(sigma²))`, where `A = G + diag(1/sigma²)`; 0 if `A` cannot be
/// factored.
pub(crate) fn log_odds(
    products: &dyn Fn(usize, usize) -> f64,
    with_residual: &dyn Fn(usize) -> f64,
    mean: &[f64],
    sigma: &[f64],
) -> f64 {
    checked_log_odds(products, with_residual, mean, sigma).unwrap_or(0.0)
}

/// The same; `None` if `A` cannot be factored.
pub(crate) fn checked_log_odds(
    products: &dyn Fn(usize, usize) -> f64,
    with_residual: &dyn Fn(usize) -> f64,
    mean: &[f64],
    sigma: &[f64],
) -> Option<f64> {
    let count = mean.len();
    let mut by_mean = 0.0;
    let mut right = vec![0.0; count];
    for i in 0..count {
        let by_prior: f64 = (0..count).map(|j| products(i, j) * mean[j]).sum();
        by_mean += mean[i] * (with_residual(i) - 0.5 * by_prior);
        right[i] = (with_residual(i) - by_prior) * sigma[i];
    }
    let scaled = |i: usize, j: usize| f64::from(u8::from(i == j)) + sigma[i] * sigma[j] * products(i, j);
    let (lower, half_log_det) = small_factor(count, &scaled)?;
    let solved = forward_substitution(&lower, &right);
    Some(by_mean - half_log_det + 0.5 * solved.iter().map(|value| value * value).sum::<f64>())
}

/// Posterior mean and 1-σ; `None` if the columns are not separable.
pub(crate) fn estimate(
    products: &dyn Fn(usize, usize) -> f64,
    with_residual: &dyn Fn(usize) -> f64,
    mean: &[f64],
    sigma: &[f64],
) -> Option<Estimate> {
    posterior(products, with_residual, mean, sigma).map(Estimate::of)
}

/// The same as mean and covariance.
fn posterior(
    products: &dyn Fn(usize, usize) -> f64,
    with_residual: &dyn Fn(usize) -> f64,
    mean: &[f64],
    sigma: &[f64],
) -> Option<(Vec<f64>, DMatrix<f64>)> {
    let count = mean.len();
    // In units of the prior's sigma, so that metres and newtons are comparable.
    let scaled = DMatrix::from_fn(count, count, |i, j| {
        f64::from(u8::from(i == j)) + sigma[i] * sigma[j] * products(i, j)
    });
    let inverse = Factor::of(&scaled)?.inverse();
    let right: Vec<f64> = (0..count).map(|i| sigma[i] * with_residual(i) + mean[i] / sigma[i]).collect();
    let value = (0..count)
        .map(|i| sigma[i] * (0..count).map(|j| inverse[(i, j)] * right[j]).sum::<f64>())
        .collect::<Vec<_>>();
    let covariance = DMatrix::from_fn(count, count, |i, j| sigma[i] * sigma[j] * inverse[(i, j)]);
    value.iter().all(|value| value.is_finite()).then_some((value, covariance))
}

/// Cholesky of a few rows: the factor row by row, and half the logarithm of the determinant.
fn small_factor(count: usize, of: &dyn Fn(usize, usize) -> f64) -> Option<(Vec<Vec<f64>>, f64)> {
    let mut lower = vec![vec![0.0; count]; count];
    let mut half_log_det = 0.0;
    for i in 0..count {
        for j in 0..=i {
            let rest = of(i, j) - (0..j).map(|k| lower[i][k] * lower[j][k]).sum::<f64>();
            if i == j {
                if rest.is_nan() || rest <= 0.0 {
                    return None;
                }
                lower[i][i] = rest.sqrt();
                half_log_det += lower[i][i].ln();
            } else {
                lower[i][j] = rest / lower[j][j];
            }
        }
    }
    Some((lower, half_log_det))
}

fn forward_substitution(lower: &[Vec<f64>], right: &[f64]) -> Vec<f64> {
    let mut solved: Vec<f64> = Vec::with_capacity(right.len());
    for (i, row) in lower.iter().enumerate() {
        let rest = right[i] - row.iter().zip(&solved).map(|(a, b)| a * b).sum::<f64>();
        solved.push(rest / row[i]);
    }
    solved
}

/// `ln Σ exp`.
pub(crate) fn log_sum_exp(values: &[f64]) -> f64 {
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest.is_finite() {
        largest + values.iter().map(|value| (value - largest).exp()).sum::<f64>().ln()
    } else {
        largest
    }
}
