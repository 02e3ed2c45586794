//! Dense algebra on a few thousand rows, one thread: Cholesky factors in blocks, so that most of the work is nalgebra's
//! matrix product.

use nalgebra::DMatrix;

use crate::constants::FACTOR_COLUMNS;

/// Lower Cholesky factor of a covariance.
#[derive(Debug, Clone)]
pub(crate) struct Factor {
    lower: DMatrix<f64>,
}

impl Factor {
    /// Factor of a symmetric matrix, of which only the lower half is read; `None` if it is not positive definite.
    pub(crate) fn of(matrix: &DMatrix<f64>) -> Option<Factor> {
        // nalgebra's own factorisation takes five times as long: it has no blocks.
        let (mut lower, size) = (matrix.clone(), matrix.nrows());
        for first in (0..size).step_by(FACTOR_COLUMNS) {
            let width = FACTOR_COLUMNS.min(size - first);
            let (next, below) = (first + width, size - first - width);
            let diagonal = lower.view((first, first), (width, width)).into_owned().cholesky()?.unpack();
            lower.view_mut((first, first), (width, width)).copy_from(&diagonal);
            solve_right(&mut lower, &diagonal, first, next);
            let panel = lower.view((next, first), (below, width)).into_owned();
            for column in (0..below).step_by(FACTOR_COLUMNS) {
                let (rows, columns) = (below - column, FACTOR_COLUMNS.min(below - column));
                let across = panel.rows(column, columns).transpose();
                let mut rest = lower.view_mut((next + column, next + column), (rows, columns));
                rest.gemm(-1.0, &panel.rows(column, rows), &across, 1.0);
            }
        }
        lower.fill_upper_triangle(0.0, 1);
        (0..size).all(|i| lower[(i, i)].is_finite() && lower[(i, i)] > 0.0).then_some(Factor { lower })
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.lower.nrows()
    }

    /// Rows of `L⁻¹ columns`, where the columns are zero above row `from` and only those from there on are passed, all or
    /// some.
    pub(crate) fn whiten_from(&self, from: usize, columns: &mut DMatrix<f64>) {
        let size = columns.nrows();
        for first in (0..size).step_by(FACTOR_COLUMNS) {
            let width = FACTOR_COLUMNS.min(size - first);
            let (next, below) = (first + width, size - first - width);
            let diagonal = self.lower.view((from + first, from + first), (width, width));
            diagonal.solve_lower_triangular_mut(&mut columns.rows_mut(first, width));
            let solved = columns.rows(first, width).into_owned();
            let panel = self.lower.view((from + next, from + first), (below, width));
            columns.rows_mut(next, below).gemm(-1.0, &panel, &solved, 1.0);
        }
    }

    /// `L⁻ᵀ columns`.
    pub(crate) fn solve_transposed(&self, columns: &mut DMatrix<f64>) {
        let size = columns.nrows();
        for first in (0..size).step_by(FACTOR_COLUMNS).rev() {
            let width = FACTOR_COLUMNS.min(size - first);
            let (next, below) = (first + width, size - first - width);
            let panel = self.lower.view((next, first), (below, width)).transpose();
            let solved = columns.rows(next, below).into_owned();
            columns.rows_mut(first, width).gemm(-1.0, &panel, &solved, 1.0);
            let diagonal = self.lower.view((first, first), (width, width));
            diagonal.tr_solve_lower_triangular_mut(&mut columns.rows_mut(first, width));
        }
    }

    /// `½ ln det` of the factored matrix.
    pub(crate) fn half_log_det(&self) -> f64 {
        (0..self.len()).map(|i| self.lower[(i, i)].ln()).sum()
    }

    /// The factor itself.
    pub(crate) fn lower(&self) -> &DMatrix<f64> {
        &self.lower
    }

    /// The inverse of the factored matrix.
    pub(crate) fn inverse(&self) -> DMatrix<f64> {
        let size = self.len();
        // L⁻¹, whose columns are zero above the diagonal.
        let mut whitened = DMatrix::identity(size, size);
        for first in (0..size).step_by(FACTOR_COLUMNS) {
            let width = FACTOR_COLUMNS.min(size - first);
            let (next, below) = (first + width, size - first - width);
            let diagonal = self.lower.view((first, first), (width, width));
            diagonal.solve_lower_triangular_mut(&mut whitened.view_mut((first, 0), (width, next)));
            let solved = whitened.view((first, 0), (width, next)).into_owned();
            let panel = self.lower.view((next, first), (below, width));
            whitened.view_mut((next, 0), (below, next)).gemm(-1.0, &panel, &solved, 1.0);
        }
        let (transposed, mut inverse) = (whitened.transpose(), DMatrix::zeros(size, size));
        for first in (0..size).step_by(FACTOR_COLUMNS) {
            let (width, below) = (FACTOR_COLUMNS.min(size - first), size - first);
            let (left, right) = ((first, first), whitened.view((first, first), (below, width)));
            let mut lower = inverse.view_mut((first, first), (below, width));
            lower.gemm(1.0, &transposed.view(left, (below, below)), &right, 0.0);
        }
        inverse.fill_upper_triangle_with_lower_triangle();
        inverse
    }
}

/// Columns `first..next` of `lower`, below row `next`, times `diagonal⁻ᵀ`.
fn solve_right(lower: &mut DMatrix<f64>, diagonal: &DMatrix<f64>, first: usize, next: usize) {
    let size = lower.nrows();
    for (j, column) in (first..next).enumerate() {
        for (k, before) in (first..column).enumerate() {
            let (left, right) = lower.as_mut_slice().split_at_mut(column * size);
            let (left, factor) = (&left[before * size + next..(before + 1) * size], diagonal[(j, k)]);
            right[next..size].iter_mut().zip(left).for_each(|(to, from)| *to -= factor * from);
        }
        let scale = 1.0 / diagonal[(j, j)];
        lower.as_mut_slice()[column * size + next..(column + 1) * size]
            .iter_mut()
            .for_each(|value| *value *= scale);
    }
}

/// A column.
pub(crate) fn column(matrix: &DMatrix<f64>, index: usize) -> &[f64] {
    &matrix.as_slice()[index * matrix.nrows()..][..matrix.nrows()]
}

/// A column.
pub(crate) fn column_mut(matrix: &mut DMatrix<f64>, index: usize) -> &mut [f64] {
    let rows = matrix.nrows();
    &mut matrix.as_mut_slice()[index * rows..][..rows]
}

/// `leftᵀ right`.
pub(crate) fn inner(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    // Not `tr_mul`: that is a scalar product per element.
    left.transpose() * right
}

/// `left rightᵀ`.
pub(crate) fn outer(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    left * right.transpose()
}

/// `left right`.
pub(crate) fn product(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    left * right
}

/// A factor `S` with `S Sᵀ` = a symmetric positive semidefinite matrix given row by row; as many columns as it has
/// rank.
pub(crate) fn root(rows: &[f64], size: usize) -> DMatrix<f64> {
    let mut left = DMatrix::from_fn(size, size, |i, j| rows[i * size + j]);
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
    DMatrix::from_fn(size, columns.len(), |i, j| columns[j][i])
}

fn largest_diagonal(matrix: &DMatrix<f64>, min: f64) -> Option<usize> {
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
        let again = outer(&root, &root);
        for i in 0..3 {
            for j in 0..3 {
                assert!((again[(i, j)] - full[3 * i + j]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn whitening_the_tail_is_whitening_the_whole_with_zeros_above() {
        let matrix =
            DMatrix::from_fn(5, 5, |i, j| if i == j { 3.0 } else { 1.0 / (1.0 + i.abs_diff(j) as f64) });
        let factor = Factor::of(&matrix).unwrap();
        let mut tail = DMatrix::from_fn(3, 1, |i, _| i as f64 + 1.0);
        let mut whole = DMatrix::from_fn(5, 1, |i, _| if i < 2 { 0.0 } else { i as f64 - 1.0 });
        factor.whiten_from(2, &mut tail);
        factor.whiten_from(0, &mut whole);
        for i in 0..3 {
            assert!((tail[(i, 0)] - whole[(i + 2, 0)]).abs() < 1e-12);
        }
    }
}
