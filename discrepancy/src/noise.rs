//! Noise model of a session without effects: a Gaussian process whose shapes follow from physics and whose few sizes
//! are fitted on the phases that are not in question.
//!
//! Drift of the suit's orientations, soft tissue that follows the joints, stance offsets of some millimetres, an
//! unknown smooth function of the pose, sway, the plate's noise. Without these coloured components effects would be
//! detected in every session.

pub(crate) mod cop;
mod force;
mod likelihood;

use nalgebra::DMatrix;

use crate::linear::{Factor, inner};
use crate::reconcile::ReconcileError;
use crate::rows::Rows;

/// The noise of all channels, factored for whitening.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    /// Factor of the covariance of the centre of pressure; two rows a block.
    pub(crate) cop: Factor,
    /// The same without the uncertainty of the stance offsets.
    pub(crate) cop_without_stances: Factor,
    /// Covariance of the stance offsets, m².
    pub(crate) stances_m2: DMatrix<f64>,
    /// Factor of each measured force channel, in the order of [`Rows::force_axes`].
    pub(crate) force: Vec<Factor>,
    /// Fitted sizes: of the centre of pressure, and of each force channel.
    sizes: (cop::Sizes, Vec<force::Sizes>),
}

/// Noise of a channel in blocks that follow those of a recording, conditioned on these.
#[derive(Debug)]
pub(crate) struct Continuation {
    /// Covariance with the whitened rows of the recording: a row each, a column for each further row.
    pub(crate) with_whitened: DMatrix<f64>,
    /// Covariance of the further rows given the recording's.
    pub(crate) covariance: DMatrix<f64>,
}

impl Noise {
    /// Fitted on the phases that are not in question.
    pub(crate) fn fit(rows: &Rows<'_>) -> Result<Noise, ReconcileError> {
        let no_noise = |channel| ReconcileError::NoNoise { channel };
        let of_cop = cop::fit(rows).ok_or(no_noise("centre of pressure"))?;
        let [cop, cop_without_stances] =
            Noise::of_cop(rows, &of_cop).ok_or(no_noise("centre of pressure"))?;
        let stances_m2 = cop::stance_covariance_m2(rows);
        let of_axis = |&axis: &usize| {
            let sizes = force::fit(rows, axis)?;
            Some((Factor::of(&force::covariance_n2(rows, axis, &sizes))?, sizes))
        };
        let of_force = rows.force_axes().iter().map(of_axis).collect::<Option<Vec<_>>>();
        let (force, of_force) = of_force.ok_or(no_noise("force"))?.into_iter().unzip();
        Ok(Noise { cop, cop_without_stances, stances_m2, force, sizes: (of_cop, of_force) })
    }

    fn of_cop(rows: &Rows<'_>, sizes: &cop::Sizes) -> Option<[Factor; 2]> {
        let covariance_m2 = cop::covariance_m2(rows, sizes);
        let without_m2 = &covariance_m2 - cop::stance_covariance_m2(rows);
        Some([Factor::of(&covariance_m2)?, Factor::of(&without_m2)?])
    }

    /// Noise of centre of pressure and vertical force in the blocks of `all` beyond those on which this was fitted,
    /// which are its first.
    pub(crate) fn continuation(&self, all: &Rows<'_>) -> [Continuation; 2] {
        let (of_cop, of_force) = &self.sizes;
        [
            Continuation::of(&self.cop, &cop::covariance_m2(all, of_cop)),
            Continuation::of(&self.force[0], &force::covariance_n2(all, all.force_axes()[0], &of_force[0])),
        ]
    }
}

impl Continuation {
    /// Of a covariance whose first rows have this factor `L`: with `[K Cᵀ; C D]`, `L⁻¹ Cᵀ` and `D − C K⁻¹ Cᵀ`.
    fn of(factor: &Factor, covariance: &DMatrix<f64>) -> Continuation {
        let before = factor.len();
        let further = covariance.nrows() - before;
        let mut with_whitened = covariance.view((0, before), (before, further)).into_owned();
        factor.whiten_from(0, &mut with_whitened);
        let own = covariance.view((before, before), (further, further));
        let covariance = own - inner(&with_whitened, &with_whitened);
        Continuation { with_whitened, covariance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::clean;

    #[test]
    fn the_inertia_that_a_model_lacks_is_no_noise() {
        let session = clean(5);
        let mut without = session.clone();
        without.has_inertia = false;
        for block in &mut without.blocks {
            let seen = &mut block.observation;
            seen.cop_predicted_m = [seen.com_m[0], seen.com_m[1]];
            (seen.slope, seen.slope_is_measured) = ([0.0; 2], false);
            seen.force_predicted_n = [0.0, 0.0, seen.mass_kg * 9.81];
        }
        let [all, all_without] = [&session, &without].map(Rows::of);
        for block in 0..all.len() {
            let [one_m, other_m] = [&all, &all_without].map(|rows| rows.inertia_m(block));
            let is_same = (0..2).all(|axis| (one_m[axis] - other_m[axis]).abs() < 1e-9);
            assert!(is_same, "block {block}: {one_m:?} {other_m:?}");
        }
        let some: Vec<usize> = (0..all.len()).step_by(5).collect();
        for axis in 0..3 {
            let sizes = [&all, &all_without].map(|rows| force::fit(&rows.subset(&some), axis).unwrap());
            let is_same = sizes[0].iter().zip(sizes[1]).all(|(one, other)| (one - other).abs() < 1e-3);
            assert!(is_same, "axis {axis}: {sizes:?}");
        }
    }

    #[test]
    fn a_continuation_is_the_conditional_normal_distribution() {
        // Of a Markov chain with correlation r per step, variance 1: given the last, the next has mean r times it and
        // variance 1 − r², whatever came before.
        let r = 0.8_f64;
        let covariance = DMatrix::from_fn(5, 5, |i, j| r.powi(i.abs_diff(j) as i32));
        let before = Factor::of(&covariance.view((0, 0), (3, 3)).into_owned()).unwrap();
        let Continuation { with_whitened, covariance } = Continuation::of(&before, &covariance);
        let mut whitened = DMatrix::from_fn(3, 1, |i, _| [5.0, -7.0, 2.0][i]);
        before.whiten_from(0, &mut whitened);
        let mean = inner(&with_whitened, &whitened);
        for (i, expected) in [r * 2.0, r * r * 2.0].into_iter().enumerate() {
            assert!((mean[(i, 0)] - expected).abs() < 1e-12, "{}", mean[(i, 0)]);
        }
        assert!((covariance[(0, 0)] - (1.0 - r * r)).abs() < 1e-12, "{}", covariance[(0, 0)]);
        assert!((covariance[(1, 1)] - (1.0 - r.powi(4))).abs() < 1e-12, "{}", covariance[(1, 1)]);
    }
}
