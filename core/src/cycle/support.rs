//! Where the ground can push: the support polygon of the standing feet.

use super::sole::FootShape;
use crate::body::Side;
use crate::frame::{Pose, StationWorld};
use crate::math;

/// Whether a point of the floor lies in the convex hull of the left and the right sole, widened by `margin_m`.
///
/// A point is inside if no direction separates it from all corners; 32 directions tell it to about 2 % of the feet's
/// distance, on the generous side.
pub fn is_supported(
    pose: &Pose<StationWorld>,
    point_m: [f64; 2],
    soles: &[FootShape; 2],
    margin_m: f64,
) -> bool {
    const DIRECTIONS: usize = 32;
    let corners = Side::BOTH.map(|side| soles[side as usize].corners_m(pose, side));
    (0..DIRECTIONS).all(|index| {
        let angle = core::f64::consts::TAU * index as f64 / DIRECTIONS as f64;
        let (sine, cosine) = math::sin_cos(angle);
        let along = |point: [f64; 2]| cosine * point[0] + sine * point[1];
        let reach = corners.iter().flatten().map(|corner| along(*corner)).fold(f64::NEG_INFINITY, f64::max);
        along(point_m) <= reach + margin_m
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{SEGMENTS, Skeleton};
    use nalgebra::{UnitQuaternion, Vector3};

    fn standing() -> Pose<StationWorld> {
        let origin = Skeleton::nominal(1.77).t_pose_m().map(Vector3::from);
        Pose::new(origin, [UnitQuaternion::identity(); SEGMENTS])
    }

    #[test]
    fn between_the_feet_is_supported_and_a_metre_away_is_not() {
        let pose = standing();
        let soles = Side::BOTH.map(|side| FootShape::by_stature(&pose, side, 1.77));
        assert!(is_supported(&pose, [0.05, 0.0], &soles, 0.0));
        assert!(is_supported(&pose, [0.15, 0.1], &soles, 0.0));
        for outside in [[0.4, 0.0], [-0.2, 0.0], [0.05, 0.4], [0.05, -0.4]] {
            assert!(!is_supported(&pose, outside, &soles, 0.02), "{outside:?}");
        }
    }

    #[test]
    fn longer_soles_carry_farther() {
        let pose = standing();
        let short = Side::BOTH.map(|side| FootShape::by_stature(&pose, side, 1.77));
        let toe_m = short[0].along_m[1];
        let long = short.map(|sole| FootShape { along_m: [sole.along_m[0], toe_m + 0.1], ..sole });
        let point_m = [toe_m + 0.05, 0.0];
        assert!(!is_supported(&pose, point_m, &short, 0.0) && is_supported(&pose, point_m, &long, 0.0));
    }
}
