//! Where a plate stands in the suit's world, from places where somebody stood still on it.
//!
//! Standing still, the centre of pressure is under the body's centre of mass. The plate tells the first, in its own
//! frame; the suit tells the second, in the world in which it sees the body. What turns and shifts one set of points
//! onto the other is the plate's frame:
//!
//! ```text
//! R(ψ) mᵢ + o = xᵢ + R(φᵢ) b + eᵢ
//! ```
//!
//! mᵢ measured, xᵢ where the suit's body puts it, φᵢ where the body looks. **ψ**, the turn, follows from places that
//! lie apart; a constant error of the body's model does not enter it. **o**, the shift, cannot be told from such an
//! error **b** (a body whose mass lies a centimetre more forward) while the body looks one way: it is known no better
//! than b is believed ([`BIAS_SIGMA_M`]), until the body has turned. Heights are not seen at all.

pub mod holds;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use thiserror::Error;

use crate::ground::GroundFrame;

/// 1-σ of where a body of the table has its centre of mass, forward and sideways in its own heading, m.
pub const BIAS_SIGMA_M: f64 = 0.02;
/// What a single hold is expected to be off by, per axis, m: sway, the suit's wander, and the step before it. Worth
/// [`EXPECTED_WEIGHT`] degrees of freedom against what the holds themselves show.
const EXPECTED_OFF_M: f64 = 0.01;
const EXPECTED_WEIGHT: f64 = 4.0;
/// No place is believed to be better known than a stance of the loop is, m.
const OFF_MIN_M: f64 = equipoise_core::anchor::STANCE_SIGMA_M;
/// So many places at least.
pub const HOLDS_MIN: usize = 3;
/// They must lie this far from their middle, root mean square, m.
pub const SPREAD_MIN_M: f64 = 0.08;
/// Holds that are off by more, root mean square, contradict each other, m.
const OFF_MAX_M: f64 = 0.05;
/// The equations are nearly linear: this is plenty.
const STEPS: usize = 30;

type Vector5 = SVector<f64, 5>;
type Matrix5 = SMatrix<f64, 5, 5>;

/// A time of standing still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hold {
    /// Centre of pressure as measured, by the frame in force, m.
    pub measured_m: [f64; 2],
    /// Where the suit's body has it, m.
    pub expected_m: [f64; 2],
    /// Where the body looks: turn to the left, rad.
    pub heading_rad: f64,
}

/// How the frame in force must be turned and shifted.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    /// Turn to the left about the world's origin, rad.
    pub yaw_rad: f64,
    /// Shift after the turn, m.
    pub shift_m: [f64; 2],
    /// How far the body's centre of mass is off the table's, forward and left, m.
    pub bias_m: [f64; 2],
    /// Covariance of yaw, shift and bias, in that order.
    covariance: Matrix5,
    /// What is left of each hold, m.
    pub residuals_m: Vec<[f64; 2]>,
    /// 1-σ of a single hold, per axis, m.
    pub hold_sigma_m: f64,
    /// How far the places lie from their middle, root mean square, m.
    pub spread_m: f64,
}

/// Why there is no correction.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum RegisterRefusal {
    /// Too few places.
    #[error("{found} places are too few; stand still at {HOLDS_MIN} at least")]
    TooFew {
        /// How many there were.
        found: usize,
    },
    /// They are in one place.
    #[error(
        "the places lie {:.0} mm from their middle, {:.0} mm are needed to tell a turn; stand nearer to the corners",
        1e3 * spread_m, 1e3 * SPREAD_MIN_M
    )]
    NotSpread {
        /// Root mean square distance from their middle, m.
        spread_m: f64,
    },
    /// No turn and shift makes one of the other.
    #[error(
        "no turn and shift of the plate explains the places: they are off by {:.0} mm, place {} most; is the plate's scale \
         right (`equipoise verify`), was it tared, and did nobody lean on anything?",
        1e3 * off_m, worst + 1
    )]
    Contradictory {
        /// Root mean square of what is left, per axis, m.
        off_m: f64,
        /// Which place is off most, from 0.
        worst: usize,
    },
}

/// Finds the correction.
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

/// What the holds show of their own σ, with what was expected of it.
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

    /// What is left of it, and how that changes with what is looked for.
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
    /// 1-σ of the turn, rad.
    pub fn yaw_sigma_rad(&self) -> f64 {
        self.covariance[(0, 0)].max(0.0).sqrt()
    }

    /// Where a point of the plate really is, and its 1-σ by axis, m.
    pub fn point_m(&self, by_frame_in_force_m: [f64; 2]) -> ([f64; 2], [f64; 2]) {
        let turned = turn(self.yaw_rad) * Vector2::from(by_frame_in_force_m);
        let slope = SMatrix::<f64, 2, 3>::new(-turned.y, 1.0, 0.0, turned.x, 0.0, 1.0);
        let covariance = slope * self.covariance.fixed_view::<3, 3>(0, 0) * slope.transpose();
        let point = turned + Vector2::from(self.shift_m);
        (point.into(), [0, 1].map(|axis| covariance[(axis, axis)].max(0.0).sqrt()))
    }

    /// 1-σ of the body's bias, forward and left, m: near [`BIAS_SIGMA_M`] if the body never turned.
    pub fn bias_sigma_m(&self) -> [f64; 2] {
        [3, 4].map(|axis| self.covariance[(axis, axis)].max(0.0).sqrt())
    }

    /// A frame that stood in force, put right.
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

/// The same direction, within half a turn of zero.
fn wrapped(angle_rad: f64) -> f64 {
    f64::atan2(angle_rad.sin(), angle_rad.cos())
}
