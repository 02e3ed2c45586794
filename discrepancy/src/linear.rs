//! Dense algebra on a few thousand rows, one thread: a thin wrapper of the parts of faer that the statistics use.

use faer::linalg::matmul::matmul;
use faer::linalg::solvers::DenseSolveCore;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Accum, Mat, MatRef, Par, Side};

/// Lower Cholesky factor of a covariance.
#[derive(Debug, Clone)]
pub(crate) struct Factor {
    lower: Mat<f64>,
}

impl Factor {
    /// Factor of a symmetric matrix, of which only the lower half is read; `None` if it is not positive definite.
    pub(crate) fn of(matrix: &Mat<f64>) -> Option<Factor> {
        let lower = matrix.llt(Side::Lower).ok()?.L().to_owned();
        (0..lower.nrows())
            .all(|i| lower[(i, i)].is_finite() && lower[(i, i)] > 0.0)
            .then_some(Factor { lower })
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.lower.nrows()
    }

    /// Rows of `L⁻¹ columns`, where the columns are zero above row `from` and only those from there on are passed, all or
    /// some.
    pub(crate) fn whiten_from(&self, from: usize, columns: &mut Mat<f64>) {
        let count = columns.nrows();
        let block = self.lower.as_ref().submatrix(from, from, count, count);
        solve_lower_triangular_in_place(block, columns.as_mut(), Par::Seq);
    }

    /// `L⁻ᵀ columns`.
    pub(crate) fn solve_transposed(&self, columns: &mut Mat<f64>) {
        solve_upper_triangular_in_place(self.lower.as_ref().transpose(), columns.as_mut(), Par::Seq);
    }

    /// `½ ln det` of the factored matrix.
    pub(crate) fn half_log_det(&self) -> f64 {
        (0..self.len()).map(|i| self.lower[(i, i)].ln()).sum()
    }

    /// The factor itself.
    pub(crate) fn lower(&self) -> MatRef<'_, f64> {
        self.lower.as_ref()
    }

    /// The inverse of the factored matrix.
    pub(crate) fn inverse(matrix: &Mat<f64>) -> Option<Mat<f64>> {
        Some(matrix.llt(Side::Lower).ok()?.inverse())
    }
}

/// `leftᵀ right`.
pub(crate) fn inner(left: MatRef<'_, f64>, right: MatRef<'_, f64>) -> Mat<f64> {
    let mut product = Mat::zeros(left.ncols(), right.ncols());
    matmul(product.as_mut(), Accum::Replace, left.transpose(), right, 1.0, Par::Seq);
    product
}

/// `left rightᵀ`.
pub(crate) fn outer(left: MatRef<'_, f64>, right: MatRef<'_, f64>) -> Mat<f64> {
    let mut product = Mat::zeros(left.nrows(), right.nrows());
    matmul(product.as_mut(), Accum::Replace, left, right.transpose(), 1.0, Par::Seq);
    product
}

/// `left right`.
pub(crate) fn product(left: MatRef<'_, f64>, right: MatRef<'_, f64>) -> Mat<f64> {
    let mut product = Mat::zeros(left.nrows(), right.ncols());
    matmul(product.as_mut(), Accum::Replace, left, right, 1.0, Par::Seq);
    product
}

/// A factor `S` with `S Sᵀ` = a symmetric positive semidefinite matrix given row by row; as many columns as it has
/// rank.
pub(crate) fn root(rows: &[f64], size: usize) -> Mat<f64> {
    let mut left = Mat::from_fn(size, size, |i, j| rows[i * size + j]);
    let trace: f64 = (0..size).map(|i| left[(i, i)]).sum();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    while let Some(pivot) = largest_diagonal(&left, 1e-9 * trace) {
        let scale = left[(pivot, pivot)].sqrt();
        let column: Vec<f64> = (0..size).map(|i| left[(i, pivot)] / scale).collect();
        for i in 0..size {
            for j in 0..size {
                left[(i, j)] -= column[i] * column[j];
            }
        }
        columns.push(column);
        if columns.len() == size {
            break;
        }
    }
    Mat::from_fn(size, columns.len(), |i, j| columns[j][i])
}

fn largest_diagonal(matrix: &Mat<f64>, min: f64) -> Option<usize> {
    let largest = (0..matrix.nrows()).max_by(|&a, &b| matrix[(a, a)].total_cmp(&matrix[(b, b)]))?;
    (matrix[(largest, largest)] > min).then_some(largest)
}

/// Length of a vector.
pub(crate) fn norm(vector: [f64; 3]) -> f64 {
    vector.iter().map(|value| value * value).sum::<f64>().sqrt()
}

/// Scalar product.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Independent sums: floating-point addition is not associative, so a single sum is not vectorised.
    const LANES: usize = 8;
    let mut sums = [0.0; LANES];
    let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_chunks.zip(b_chunks) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    rest + sums.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_root_times_itself_is_the_matrix() {
        let full = [4.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 9.0];
        let root = root(&full, 3);
        assert_eq!(root.ncols(), 2, "the first two rows depend on each other");
        let again = outer(root.as_ref(), root.as_ref());
        for i in 0..3 {
            for j in 0..3 {
                assert!((again[(i, j)] - full[3 * i + j]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn whitening_the_tail_is_whitening_the_whole_with_zeros_above() {
        let matrix = Mat::from_fn(5, 5, |i, j| if i == j { 3.0 } else { 1.0 / (1.0 + i.abs_diff(j) as f64) });
        let factor = Factor::of(&matrix).unwrap();
        let mut tail = Mat::from_fn(3, 1, |i, _| i as f64 + 1.0);
        let mut whole = Mat::from_fn(5, 1, |i, _| if i < 2 { 0.0 } else { i as f64 - 1.0 });
        factor.whiten_from(2, &mut tail);
        factor.whiten_from(0, &mut whole);
        for i in 0..3 {
            assert!((tail[(i, 0)] - whole[(i + 2, 0)]).abs() < 1e-12);
        }
    }
}
