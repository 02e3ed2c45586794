//! Effect on the ground reaction of forces on the body, and of errors in the position of its CoM.
//!
//! From the moments about the point `P` on the floor where the reaction acts (Newton and Euler; `h` the height of the
//! CoM over the floor, `f = g + C̈_z`, `L̇` the rate of angular momentum, `p` and `F'` point and force of the other
//! contacts): `F_z P = M f C_xy − M C̈_xy h + (−L̇_y, L̇_x) − F'_z p_xy + F'_xy p_z`, and the ground's force is `F = M
//! (g + C̈) − F'`. Every column here is the derivative of this `P` relative to the predicted one.

use super::Observation;
use crate::body::{Segment, Side};
use crate::math;

/// Change by one parameter, per unit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Column {
    /// Change of the CoP, m per unit.
    pub(super) cop_m: [f64; 2],
    /// Change of the ground's force on the body, N per unit.
    pub(super) force_n: [f64; 3],
}

impl Column {
    /// A column that changes the CoP alone.
    pub(super) fn of_cop(cop_m: [f64; 2]) -> Column {
        Column { cop_m, force_n: [0.0; 3] }
    }

    /// Sum of two columns.
    pub(super) fn plus(self, other: Column) -> Column {
        Column {
            cop_m: core::array::from_fn(|axis| self.cop_m[axis] + other.cop_m[axis]),
            force_n: sum(self.force_n, other.force_n),
        }
    }

    /// The column times a factor.
    pub(super) fn times(self, factor: f64) -> Column {
        Column {
            cop_m: self.cop_m.map(|part| factor * part),
            force_n: self.force_n.map(|part| factor * part),
        }
    }
}

/// A point and its acceleration, m and m/s²; or a direction and its second derivative, 1 and 1/s².
#[derive(Debug, Clone, Copy)]
pub(super) struct Moving {
    /// Position or direction.
    pub(super) at: [f64; 3],
    /// Its second derivative.
    pub(super) acceleration: [f64; 3],
}

impl Moving {
    /// Sum of the two.
    pub(super) fn plus(self, other: Moving) -> Moving {
        Moving { at: sum(self.at, other.at), acceleration: sum(self.acceleration, other.acceleration) }
    }

    /// Product with a factor.
    pub(super) fn times(self, factor: f64) -> Moving {
        Moving { at: self.at.map(|x| factor * x), acceleration: self.acceleration.map(|x| factor * x) }
    }
}

impl Observation {
    /// Vertical force over mass that the body alone requires, g + C̈_z, m/s².
    pub(super) fn specific_force_m_per_s2(&self) -> f64 {
        self.force_predicted_n[2] / self.mass_kg
    }

    /// Height of the centre of mass above the floor, m.
    pub(super) fn centre_height_m(&self) -> f64 {
        self.com_m[2] - self.floor_m
    }

    /// CoP of the body alone by the chain, m. The prediction may be shifted from it by the stance offset, which shifts
    /// everything attached to the body likewise, so arms are relative to this point.
    fn chain_cop_m(&self) -> [f64; 2] {
        let height_m = self.centre_height_m();
        [0, 1].map(|axis| self.com_m[axis] - self.slope[axis] * height_m + self.turning_m[axis])
    }

    /// The part of the predicted CoP that comes from the suit alone, m: without the slope if that was measured.
    pub(crate) fn cop_by_suit_m(&self) -> [f64; 2] {
        let height_m = if self.slope_is_measured { self.centre_height_m() } else { 0.0 };
        [0, 1].map(|axis| self.cop_predicted_m[axis] + self.slope[axis] * height_m)
    }

    /// A point fixed in a segment.
    pub(super) fn point_on(&self, segment: Segment, from_origin_m: [f64; 3]) -> Moving {
        self.origin(segment).plus(self.turned(segment, from_origin_m))
    }

    /// Grip point of a hand.
    pub(super) fn grip(&self, side: Side) -> Moving {
        let from_origin_m = match side {
            Side::Left => self.grip_m[0],
            Side::Right => self.grip_m[1],
        };
        self.point_on(side.hand(), from_origin_m)
    }

    /// A vector fixed in a segment's axes, in world axes.
    pub(super) fn turned(&self, segment: Segment, vector: [f64; 3]) -> Moving {
        let index = segment.index();
        Moving {
            at: rotated(&self.rotation[index], vector),
            acceleration: rotated(&self.rotation_acceleration_per_s2[index], vector),
        }
    }

    pub(super) fn origin(&self, segment: Segment) -> Moving {
        let index = segment.index();
        Moving { at: self.origin_m[index], acceleration: self.origin_acceleration_m_per_s2[index] }
    }

    /// Lever arm of a segment's rotation: a small rotation ε, world axes, moves the predicted CoM by `ε × arm`.
    ///
    /// The arm is `R_s φ_s`; if the anchor holds the feet, minus the leg's bones below the pelvis, each by the fraction
    /// with which it carries the pelvis (as in `sesc::suit_error`).
    pub(super) fn arm(&self, segment: Segment) -> Moving {
        let mut arm = self.turned(segment, self.phi_m[segment.index()]);
        if !self.feet_hold {
            return arm;
        }
        for side in Side::BOTH {
            for (bone_end, fraction) in [(side.lower_leg(), 0.5), (side.foot(), 0.5), (side.toe(), 0.25)] {
                if bone_end.parent() == Some(segment) {
                    let bone = self.origin(bone_end).plus(self.origin(segment).times(-1.0));
                    arm = arm.plus(bone.times(-fraction));
                }
            }
        }
        arm
    }

    /// A force on the body at a point, N.
    pub(super) fn of_force(&self, point_m: [f64; 3], force_n: [f64; 3]) -> Column {
        let under_m = self.chain_cop_m();
        let arm_m = [point_m[0] - under_m[0], point_m[1] - under_m[1], self.arm_of_shear_m(point_m[2])];
        Column { cop_m: self.of_moved_force(arm_m, force_n).cop_m, force_n: force_n.map(|part| -part) }
    }

    /// Column of a displacement of a force's point of action, m; the force itself is already included.
    pub(super) fn of_moved_force(&self, moved_m: [f64; 3], force_n: [f64; 3]) -> Column {
        let vertical_n = self.force_measured_n[2];
        Column::of_cop(
            [0, 1].map(|axis| (force_n[axis] * moved_m[2] - force_n[2] * moved_m[axis]) / vertical_n),
        )
    }

    /// Measured shear contains horizontal forces as if they acted at the CoM; the suit's motion does not contain them.
    fn arm_of_shear_m(&self, height_m: f64) -> f64 {
        if self.slope_is_measured { height_m - self.com_m[2] } else { height_m - self.floor_m }
    }

    /// Column of a displacement of the CoM from the chain's, m, with its acceleration, m/s².
    pub(super) fn of_shift(&self, shift: Moving) -> Column {
        let (height_m, specific) = (self.centre_height_m(), self.specific_force_m_per_s2());
        let Moving { at, acceleration } = shift;
        let cop_m = [0, 1].map(|axis| {
            let leant = at[axis] - self.slope[axis] * at[2];
            let lightened = (self.slope[axis] * height_m - self.turning_m[axis]) * acceleration[2] / specific;
            // Measured shear already contains it.
            let pushed = if self.slope_is_measured { 0.0 } else { height_m * acceleration[axis] / specific };
            leant + lightened - pushed
        });
        Column { cop_m, force_n: acceleration.map(|part| self.mass_kg * part) }
    }
}

/// A horizontal vector rotated left by a right angle.
pub(super) fn leftward([x, y]: [f64; 2]) -> [f64; 2] {
    [-y, x]
}

/// A 3×3 matrix as three rows.
pub(super) type Matrix = [[f64; 3]; 3];

/// A vector rotated by a matrix, row by row.
pub(super) fn rotated(matrix: &Matrix, vector: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
}

pub(super) fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|axis| a[axis] + b[axis])
}

/// `sin θ/θ` and `(1 − cos θ)/θ²`, the factors of Rodrigues' rotation formula for a rotation vector of length θ.
pub(super) fn chord(angle_rad: f64) -> (f64, f64) {
    if angle_rad.abs() < 1e-4 {
        return (1.0, 0.5);
    }
    let (sine, cosine) = math::sin_cos(angle_rad);
    (sine / angle_rad, (1.0 - cosine) / (angle_rad * angle_rad))
}

/// `a × b`.
pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The unit vectors of three axes.
pub(super) const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
