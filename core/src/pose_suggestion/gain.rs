//! Information gain of a pose: optimal design on the covariance update (Eq. 10), without performing the update.
//!
//! A row h measured with variance r subtracts `v vᵀ / (h P hᵀ + r)` from P, with `v = P hᵀ`. All terms are computed for
//! a known stance offset, because no pose of one stance can distinguish it from the body. For two rows the gains are
//! added, each relative to the P before.

use crate::kalman::{Filter, STATES};
use crate::sesc::PARAMETERS;
use crate::sesc::reduction::Rows;

/// Mean over the poses of the work of `h hᵀ`: `tr(P W)` is the CoP's variance there.
pub type Weight = [[f64; PARAMETERS]; PARAMETERS];

/// Decrease of `log det P`.
pub fn d_gain(filter: &Filter, rows: &Rows, variance_m2: [f64; 2]) -> f64 {
    over_rows(filter, rows, |axis, projected_m2, _| {
        nalgebra::ComplexField::ln_1p(projected_m2 / variance_m2[axis])
    })
}

/// Decrease of `tr P`, m².
pub fn a_gain(filter: &Filter, rows: &Rows, variance_m2: [f64; 2]) -> f64 {
    over_rows(filter, rows, |axis, projected_m2, spread| {
        spread.iter().map(|value| value * value).sum::<f64>() / (projected_m2 + variance_m2[axis])
    })
}

/// Decrease of `tr(P W)`, the CoP's variance over the poses of the work, m².
pub fn i_gain(filter: &Filter, weight: &Weight, rows: &Rows, variance_m2: [f64; 2]) -> f64 {
    let count = filter.count();
    over_rows(filter, rows, |axis, projected_m2, spread| {
        let mut square = 0.0;
        for (value, row) in spread.iter().zip(weight).take(count) {
            square += value * row.iter().zip(spread).map(|(weight, value)| weight * value).sum::<f64>();
        }
        square / (projected_m2 + variance_m2[axis])
    })
}

fn over_rows(filter: &Filter, rows: &Rows, gain: impl Fn(usize, f64, &[f64; STATES]) -> f64) -> f64 {
    [0, 1]
        .map(|axis| {
            let spread = filter.spread_given_nuisance_m2(&rows.h[axis]);
            let projected_m2: f64 = rows.h[axis].iter().zip(&spread).map(|(h, spread)| h * spread).sum();
            gain(axis, projected_m2.max(0.0), &spread)
        })
        .iter()
        .sum()
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::boxed::Box;
    use std::vec;

    use super::*;
    use bytemuck::Zeroable;

    const N: usize = 5;

    /// A filter with a stance offset correlated with θ, and a row on x alone.
    fn filter() -> Filter {
        let mut filter: Filter = Zeroable::zeroed();
        let mut covariance = vec![0.0; N * N];
        for index in 0..N {
            covariance[index * (N + 1)] = 0.2 + 0.1 * index as f64;
        }
        assert!(filter.restore(&[0.0; N], &covariance));
        filter.reset_state(N, 0.04);
        filter.reset_state(N + 1, 0.04);
        let mut h = [0.0; STATES];
        h[..=N].copy_from_slice(&[0.3, -0.7, 0.2, 0.9, -0.1, 1.0]);
        filter.update(&h, 0.0, 0.02).unwrap();
        filter
    }

    fn rows() -> Rows {
        let mut rows = Rows { h: [[0.0; PARAMETERS]; 2], offset_m: [0.0; 2] };
        rows.h[0][..N].copy_from_slice(&[0.5, 0.4, -0.3, 0.2, 0.8]);
        rows
    }

    fn weight() -> Box<Weight> {
        let mut weight: Box<Weight> = bytemuck::zeroed_box();
        for row in 0..N {
            for column in 0..N {
                weight[row][column] = if row == column { 1.0 } else { 0.2 };
            }
        }
        weight
    }

    /// P of θ for a known stance offset.
    fn covariance_given_offset(filter: &Filter) -> nalgebra::SMatrix<f64, N, N> {
        let column = |column: usize| {
            let mut unit = [0.0; PARAMETERS];
            unit[column] = 1.0;
            filter.spread_given_nuisance_m2(&unit)
        };
        nalgebra::SMatrix::from_fn(|row, at| column(at)[row])
    }

    #[test]
    fn every_gain_is_the_drop_that_the_update_makes() {
        let (before, rows, r_m2) = (filter(), rows(), 0.03);
        let mut after = before;
        // Measure the stance offset exactly, then the row.
        for axis in 0..2 {
            let mut nuisance = [0.0; STATES];
            nuisance[N + axis] = 1.0;
            after.update(&nuisance, 0.0, 1e-13).unwrap();
        }
        let mut h = [0.0; STATES];
        h[..N].copy_from_slice(&rows.h[0][..N]);
        after.update(&h, 0.0, r_m2).unwrap();
        let (p, q) = (covariance_given_offset(&before), covariance_given_offset(&after));
        let variance_m2 = [r_m2, 1.0];

        let reported = d_gain(&before, &rows, variance_m2);
        let dropped = (p.determinant() / q.determinant()).ln();
        assert!((reported - dropped).abs() < 1e-6, "{reported} {dropped}");

        let reported = a_gain(&before, &rows, variance_m2);
        assert!((reported - (p - q).trace()).abs() < 1e-9);

        let weight = weight();
        let w = nalgebra::SMatrix::<f64, N, N>::from_fn(|row, column| weight[row][column]);
        let reported = i_gain(&before, &weight, &rows, variance_m2);
        assert!((reported - ((p - q) * w).trace()).abs() < 1e-9);
    }
}
