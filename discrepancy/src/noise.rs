//! Noise model of a session without effects: a Gaussian process whose shapes follow from physics and whose few sizes
//! are fitted on the phases that are not in question.
//!
//! Drift of the suit's orientations, soft tissue that follows the joints, stance offsets of some millimetres, an
//! unknown smooth function of the pose, sway, the plate's noise. Without these coloured components effects would be
//! detected in every session.

pub(crate) mod cop;
mod force;
mod likelihood;

use faer::Mat;

use crate::linear::Factor;
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
    pub(crate) stances_m2: Mat<f64>,
    /// Factor of each measured force channel, in the order of [`Rows::force_axes`].
    pub(crate) force: Vec<Factor>,
}

impl Noise {
    /// Fitted on the phases that are not in question.
    pub(crate) fn fit(rows: &Rows<'_>) -> Result<Noise, ReconcileError> {
        let no_noise = |channel| ReconcileError::NoNoise { channel };
        let [cop, cop_without_stances] = Noise::of_cop(rows).ok_or(no_noise("centre of pressure"))?;
        let stances_m2 = cop::stance_covariance_m2(rows);
        let of_axis = |&axis: &usize| Factor::of(&force::covariance_n2(rows, axis)?);
        let force =
            rows.force_axes().iter().map(of_axis).collect::<Option<Vec<_>>>().ok_or(no_noise("force"))?;
        Ok(Noise { cop, cop_without_stances, stances_m2, force })
    }

    fn of_cop(rows: &Rows<'_>) -> Option<[Factor; 2]> {
        let covariance_m2 = cop::covariance_m2(rows)?;
        let without_m2 = &covariance_m2 - cop::stance_covariance_m2(rows);
        Some([Factor::of(&covariance_m2)?, Factor::of(&without_m2)?])
    }
}
