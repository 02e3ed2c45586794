//! Registration: the plate's pose in the suit's world, from positions at which a person stood still on the plate.
//!
//! In quiet standing, the centre of pressure is below the body's centre of mass. The plate measures the former in its
//! own frame; the suit provides the latter in the suit's world. The plate's frame follows from the rotation and
//! translation that map one set of points onto the other:
//!
//! ```text
//! R(ψ) mᵢ + o = xᵢ + R(φᵢ) b + eᵢ
//! ```
//!
//! mᵢ: measured CoP; xᵢ: CoP predicted from the suit's body; φᵢ: heading of the body. The yaw **ψ** follows from
//! positions that are apart; a constant error of the body model does not affect it. The translation **o** cannot be
//! distinguished from such an error **b** (for example a centre of mass 1 cm further forward) at a constant heading:
//! its uncertainty is that of b's prior ([`BIAS_SIGMA_M`]) until the body has turned. Heights are unobservable.

pub mod holds;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use thiserror::Error;

use crate::ground::GroundFrame;

/// Prior 1-σ of the centre of mass of a body from the table, forward and sideways in the body's heading, m.
pub const BIAS_SIGMA_M: f64 = 0.02;
/// Expected error of a single hold, per axis, m: sway, drift of the suit, and the step before it. Weighted as
/// [`EXPECTED_WEIGHT`] degrees of freedom against the scatter of the holds.
const EXPECTED_OFF_M: f64 = 0.01;
const EXPECTED_WEIGHT: f64 = 4.0;
/// Lower bound of a hold's σ: that of a stance in the loop, m.
const OFF_MIN_M: f64 = equipoise_core::anchor::STANCE_SIGMA_M;
/// Minimum count of positions.
pub const HOLDS_MIN: usize = 3;
/// Minimum root mean square distance of the positions from their mean, m.
pub const SPREAD_MIN_M: f64 = 0.08;
/// Holds with a larger root mean square residual contradict each other, m.
const OFF_MAX_M: f64 = 0.05;
/// Iterations; ample, as the equations are nearly linear.
const STEPS: usize = 30;

type Vector5 = SVector<f64, 5>;
type Matrix5 = SMatrix<f64, 5, 5>;

/// An interval of quiet standing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hold {
    /// Measured centre of pressure, in the configured frame, m.
    pub measured_m: [f64; 2],
    /// Centre of pressure predicted from the suit's body, m.
    pub expected_m: [f64; 2],
    /// Heading of the body: rotation to the left, rad.
    pub heading_rad: f64,
}

/// Correction of the configured frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    /// Rotation to the left about the world's origin, rad.
    pub yaw_rad: f64,
    /// Translation after the rotation, m.
    pub shift_m: [f64; 2],
    /// Offset of the body's centre of mass from the table's, forward and left, m.
    pub bias_m: [f64; 2],
    /// Covariance of yaw, shift and bias, in that order.
    covariance: Matrix5,
    /// Residual of each hold, m.
    pub residuals_m: Vec<[f64; 2]>,
    /// 1-σ of a single hold, per axis, m.
    pub hold_sigma_m: f64,
    /// Root mean square distance of the positions from their mean, m.
    pub spread_m: f64,
}

/// Why there is no correction.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum RegisterRefusal {
    /// Too few positions.
    #[error("{found} places are too few; stand still at {HOLDS_MIN} at least")]
    TooFew {
        /// Count of positions.
        found: usize,
    },
    /// The positions are too close to each other.
    #[error(
        "the places lie {:.0} mm from their middle, {:.0} mm are needed to tell a turn; stand nearer to the corners",
        1e3 * spread_m, 1e3 * SPREAD_MIN_M
    )]
    NotSpread {
        /// Root mean square distance from their mean, m.
        spread_m: f64,
    },
    /// No rotation and translation maps one set of points onto the other.
    #[error(
        "no turn and shift of the plate explains the places: they are off by {:.0} mm, place {} most; is the plate's scale \
         right (`equipoise verify`), was it tared, and did the worker lean on nothing?",
        1e3 * off_m, worst + 1
    )]
    Contradictory {
        /// Root mean square residual, per axis, m.
        off_m: f64,
        /// Index of the position with the largest residual, from 0.
        worst: usize,
    },
}

/// Estimates the correction.
///
/// # Errors
/// A [`RegisterRefusal`].
pub fn register(holds: &[Hold]) -> Result<Correction, RegisterRefusal> {
    if holds.len() < HOLDS_MIN {
        return Err(RegisterRefusal::TooFew { found: holds.len() });
    }
    let count = holds.len() as f64;
    let middle = |point: fn(&Hold) -> Vector2<f64>| holds.iter().map(point).sum::<Vector2<f64>>() / count;
    let (measured_m, expected_m) = (middle(Hold::measured), middle(Hold::expected));
    let square: f64 = holds.iter().map(|hold| (hold.measured() - measured_m).norm_squared()).sum();
    let spread_m = (square / count).sqrt();
    if spread_m.is_nan() || spread_m < SPREAD_MIN_M {
        return Err(RegisterRefusal::NotSpread { spread_m });
    }
    let (mut sine, mut cosine) = (0.0, 0.0);
    for hold in holds {
        let (from, to) = (hold.measured() - measured_m, hold.expected() - expected_m);
        sine += from.perp(&to);
        cosine += from.dot(&to);
    }
    let yaw_rad = f64::atan2(sine, cosine);
    let shift_m = expected_m - turn(yaw_rad) * measured_m;
    let mut found = Vector5::from([yaw_rad, shift_m.x, shift_m.y, 0.0, 0.0]);
    let mut sigma_m = EXPECTED_OFF_M;
    let mut information = Matrix5::identity();
    for _ in 0..STEPS {
        let mut right = Vector5::zeros();
        information = Matrix5::zeros();
        for axis in [3, 4] {
            information[(axis, axis)] = BIAS_SIGMA_M.powi(-2);
            right[axis] = -found[axis] * BIAS_SIGMA_M.powi(-2);
        }
        for hold in holds {
            let (left_m, slope) = hold.left_over(&found);
            information += slope.transpose() * slope / (sigma_m * sigma_m);
            right -= slope.transpose() * left_m / (sigma_m * sigma_m);
        }
        let Some(inverse) = information.cholesky() else { break };
        found += inverse.solve(&right);
        sigma_m = hold_sigma_m(holds, &found);
    }
    let residuals: Vec<Vector2<f64>> = holds.iter().map(|hold| hold.left_over(&found).0).collect();
    let off_m = (residuals.iter().map(Vector2::norm_squared).sum::<f64>() / (2.0 * count)).sqrt();
    if off_m.is_nan() || off_m > OFF_MAX_M {
        let norms = residuals.iter().map(Vector2::norm).enumerate();
        let worst = norms.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(index, _)| index);
        return Err(RegisterRefusal::Contradictory { off_m, worst });
    }
    Ok(Correction {
        yaw_rad: wrapped(found[0]),
        shift_m: [found[1], found[2]],
        bias_m: [found[3], found[4]],
        covariance: information.cholesky().map(|root| root.inverse()).unwrap_or_default(),
        residuals_m: residuals.into_iter().map(Into::into).collect(),
        hold_sigma_m: sigma_m,
        spread_m,
    })
}

/// σ of a hold, from the residuals combined with the prior expectation.
fn hold_sigma_m(holds: &[Hold], found: &Vector5) -> f64 {
    let square: f64 = holds.iter().map(|hold| hold.left_over(found).0.norm_squared()).sum();
    let freedom = (2 * holds.len()) as f64 - 3.0;
    let variance = (EXPECTED_WEIGHT * EXPECTED_OFF_M.powi(2) + square) / (EXPECTED_WEIGHT + freedom.max(0.0));
    variance.sqrt().max(OFF_MIN_M)
}

impl Hold {
    fn measured(&self) -> Vector2<f64> {
        self.measured_m.into()
    }

    fn expected(&self) -> Vector2<f64> {
        self.expected_m.into()
    }

    /// Residual of the hold, and its Jacobian with respect to the parameters.
    fn left_over(&self, found: &Vector5) -> (Vector2<f64>, SMatrix<f64, 2, 5>) {
        let (turned, heading) = (turn(found[0]) * self.measured(), turn(self.heading_rad));
        let left_m = turned + Vector2::new(found[1], found[2])
            - self.expected()
            - heading * Vector2::new(found[3], found[4]);
        let mut slope = SMatrix::<f64, 2, 5>::zeros();
        slope.set_column(0, &Vector2::new(-turned.y, turned.x));
        slope.fixed_view_mut::<2, 2>(0, 1).copy_from(&Matrix2::identity());
        slope.fixed_view_mut::<2, 2>(0, 3).copy_from(&-heading);
        (left_m, slope)
    }
}

impl Correction {
    /// 1-σ of the rotation, rad.
    pub fn yaw_sigma_rad(&self) -> f64 {
        self.covariance[(0, 0)].max(0.0).sqrt()
    }

    /// Corrected position of a point of the plate, and its 1-σ by axis, m.
    pub fn point_m(&self, by_frame_in_force_m: [f64; 2]) -> ([f64; 2], [f64; 2]) {
        let turned = turn(self.yaw_rad) * Vector2::from(by_frame_in_force_m);
        let slope = SMatrix::<f64, 2, 3>::new(-turned.y, 1.0, 0.0, turned.x, 0.0, 1.0);
        let covariance = slope * self.covariance.fixed_view::<3, 3>(0, 0) * slope.transpose();
        let point = turned + Vector2::from(self.shift_m);
        (point.into(), [0, 1].map(|axis| covariance[(axis, axis)].max(0.0).sqrt()))
    }

    /// 1-σ of the body's bias, forward and left, m: close to [`BIAS_SIGMA_M`] if the body never turned.
    pub fn bias_sigma_m(&self) -> [f64; 2] {
        [3, 4].map(|axis| self.covariance[(axis, axis)].max(0.0).sqrt())
    }

    /// Applies the correction to the configured frame.
    pub fn of_frame(&self, frame: &GroundFrame) -> GroundFrame {
        let [x, y, z] = frame.origin_m;
        let ([x, y], _) = self.point_m([x, y]);
        GroundFrame { origin_m: [x, y, z], yaw_rad: wrapped(frame.yaw_rad + self.yaw_rad), ..*frame }
    }
}

fn turn(angle_rad: f64) -> Matrix2<f64> {
    let (sine, cosine) = angle_rad.sin_cos();
    Matrix2::new(cosine, -sine, sine, cosine)
}

/// The same direction, within ±π.
fn wrapped(angle_rad: f64) -> f64 {
    f64::atan2(angle_rad.sin(), angle_rad.cos())
}
