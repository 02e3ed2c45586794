//! Inverse kinematics of a leg between a given hip and ankle: two links and a hinge, in closed form.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// A leg is never fully extended or folded: there the bending direction of its knee is undefined.
const LEAST_BEND_M: f64 = 1e-6;

/// A solved leg.
#[derive(Debug, Clone, Copy)]
pub struct Leg {
    /// `world_from_upper_leg`.
    pub world_from_upper: Rotation3<f64>,
    /// `world_from_lower_leg`.
    pub world_from_lower: Rotation3<f64>,
    /// Cosine of the angle between thigh and shank at the knee (π rad: straight).
    cos_knee_angle: f64,
}

impl Leg {
    /// Flexion of the knee, rad; 0 is straight.
    pub fn knee_flexion_rad(&self) -> f64 {
        core::f64::consts::PI - self.cos_knee_angle.acos()
    }
}

/// The leg from `hip_m` towards `ankle_m` with links of `[thigh, shank]` metres whose knee points along `knee_forward`
/// (world). A leg that is too short ends, fully extended, before the ankle.
pub fn solve(
    hip_m: Vector3<f64>,
    ankle_m: Vector3<f64>,
    lengths_m: [f64; 2],
    knee_forward: Vector3<f64>,
) -> Leg {
    let [thigh, shank] = lengths_m;
    let span = ankle_m - hip_m;
    let down = span.try_normalize(1e-9).unwrap_or(-Vector3::z());
    let distance = span.norm().clamp((thigh - shank).abs() + LEAST_BEND_M, thigh + shank - LEAST_BEND_M);
    // If the leg is parallel to its knee's direction it is horizontal; then its knee points up.
    let forward = (knee_forward - down * knee_forward.dot(&down)).try_normalize(1e-6).unwrap_or(Vector3::z());
    // The law of cosines gives the angle at the hip between thigh and span.
    let cos_hip = (thigh * thigh + distance * distance - shank * shank) / (2.0 * thigh * distance);
    let knee_m = hip_m + thigh * (down * cos_hip + forward * (1.0 - cos_hip * cos_hip).sqrt());
    let hinge = forward.cross(&down);
    let along = |from: Vector3<f64>, to: Vector3<f64>| {
        let up = (from - to).normalize();
        let axes = Matrix3::from_columns(&[hinge.cross(&up), hinge, up]);
        Rotation3::from_matrix_unchecked(axes)
    };
    Leg {
        world_from_upper: along(hip_m, knee_m),
        world_from_lower: along(knee_m, ankle_m),
        cos_knee_angle: (thigh * thigh + shank * shank - distance * distance) / (2.0 * thigh * shank),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_leg_ends_at_the_ankle_with_its_knee_in_front() {
        let (hip, ankle) = (Vector3::new(-0.1, 0.09, 0.8), Vector3::new(0.02, 0.13, 0.09));
        let leg = solve(hip, ankle, [0.43, 0.42], Vector3::x());
        let knee = hip + leg.world_from_upper * Vector3::new(0.0, 0.0, -0.43);
        let end = knee + leg.world_from_lower * Vector3::new(0.0, 0.0, -0.42);
        assert!((end - ankle).norm() < 1e-12);
        assert!(knee.x > 0.1, "{knee:?}");
        // A knee is a hinge: both links share their Y axis.
        assert!((leg.world_from_upper * Vector3::y() - leg.world_from_lower * Vector3::y()).norm() < 1e-7);
        let bend = leg.world_from_upper.inverse() * leg.world_from_lower;
        assert!((bend.scaled_axis() - Vector3::y() * leg.knee_flexion_rad()).norm() < 1e-7);
    }

    #[test]
    fn a_straight_leg_stands_upright() {
        let leg = solve(Vector3::z() * 0.8499, Vector3::zeros(), [0.43, 0.42], Vector3::x());
        assert!(leg.world_from_upper.angle() < 0.03 && leg.world_from_lower.angle() < 0.03);
    }

    #[test]
    fn a_leg_too_short_is_stretched() {
        let leg = solve(Vector3::z() * 0.9, Vector3::zeros(), [0.43, 0.42], Vector3::x());
        assert!(leg.knee_flexion_rad() < 0.01);
    }
}
