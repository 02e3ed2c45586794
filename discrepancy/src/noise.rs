//! What is left over when nothing is missing: a Gaussian process whose shapes are physics and whose few sizes are fitted
//! where nothing is suspected.
//!
//! Suit orientations that wander, soft tissue that follows the joints, a stance put down some millimetres off, an unknown
//! smooth function of the pose, sway, the plate's own noise. Without these colours every session has "effects".

pub(crate) mod fit;
pub(crate) mod force;
pub(crate) mod kernels;
mod likelihood;
mod minimise;

use faer::Mat;

use crate::linear::Factor;
use crate::options::ReconcileError;
use crate::rows::Rows;

/// The noise of all channels, ready to whiten with.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    /// Factor of the covariance of the centre of pressure; two rows a block.
    pub(crate) cop: Factor,
    /// The same without what is not known of where the stances were put down.
    pub(crate) cop_without_stances: Factor,
    /// Covariance of where the stances were put down, m².
    pub(crate) stances_m2: Mat<f64>,
    /// Factor of each measured force channel, in the order of [`Rows::force_axes`].
    pub(crate) force: Vec<Factor>,
}

impl Noise {
    /// Fitted on what is not in question.
    pub(crate) fn fit(rows: &Rows<'_>) -> Result<Noise, ReconcileError> {
        let no_noise = |channel| ReconcileError::NoNoise { channel };
        let [cop, cop_without_stances] = Noise::of_cop(rows).ok_or(no_noise("centre of pressure"))?;
        let stances_m2 = kernels::stance_m2(rows);
        let of_axis = |&axis: &usize| Factor::of(&force::covariance_n2(rows, axis)?);
        let force =
            rows.force_axes().iter().map(of_axis).collect::<Option<Vec<_>>>().ok_or(no_noise("force"))?;
        Ok(Noise { cop, cop_without_stances, stances_m2, force })
    }

    fn of_cop(rows: &Rows<'_>) -> Option<[Factor; 2]> {
        let covariance_m2 = kernels::covariance_m2(rows, &fit::fit(rows)?);
        let without_m2 = &covariance_m2 - kernels::stance_m2(rows);
        Some([Factor::of(&covariance_m2)?, Factor::of(&without_m2)?])
    }
}
