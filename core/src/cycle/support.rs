//! Where the ground can push: the support polygon of the standing feet.

use crate::body::Side;
use crate::frame::{Pose, StationWorld};
use crate::math;

/// Half the width of a foot, heel behind the ankle and toe tip in front of the ball, over stature.
const HALF_WIDTH: f64 = 0.028;
const HEEL_BACK: f64 = 0.04;
const TIP_FORWARD: f64 = 0.05;
/// Ankle to ball where the skeleton does not have them apart, over stature.
const BALL_FORWARD: f64 = 0.10;

/// Whether a point of the floor lies in the convex hull of the feet, widened by `margin_m`.
///
/// A point is inside if no direction separates it from all corners; 32 directions tell it to about 2 % of the feet's
/// distance, on the generous side.
pub fn is_supported(pose: &Pose<StationWorld>, point_m: [f64; 2], height_m: f64, margin_m: f64) -> bool {
    const DIRECTIONS: usize = 32;
    let corners = corners(pose, height_m);
    (0..DIRECTIONS).all(|index| {
        let angle = core::f64::consts::TAU * index as f64 / DIRECTIONS as f64;
        let (sine, cosine) = math::sin_cos(angle);
        let along = |point: [f64; 2]| cosine * point[0] + sine * point[1];
        let reach = corners.iter().flatten().map(|corner| along(*corner)).fold(f64::NEG_INFINITY, f64::max);
        along(point_m) <= reach + margin_m
    })
}

fn corners(pose: &Pose<StationWorld>, height_m: f64) -> [[[f64; 2]; 4]; 2] {
    Side::BOTH.map(|side| {
        let ankle = pose.origin_of(side.foot());
        let ahead = pose.world_from_segment[side.foot().index()] * nalgebra::Vector3::x();
        let norm = math::hypot([ahead.x, ahead.y]).max(1e-9);
        let (x, y) = (ahead.x / norm, ahead.y / norm);
        let toe = pose.origin_of(side.toe());
        let ball = ((toe.x - ankle.x) * x + (toe.y - ankle.y) * y).max(BALL_FORWARD * height_m);
        let at =
            |forward: f64, left: f64| [ankle.x + forward * x - left * y, ankle.y + forward * y + left * x];
        let (back, front, half) =
            (-HEEL_BACK * height_m, ball + TIP_FORWARD * height_m, HALF_WIDTH * height_m);
        [at(back, half), at(back, -half), at(front, half), at(front, -half)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{SEGMENTS, Skeleton};
    use nalgebra::{UnitQuaternion, Vector3};

    #[test]
    fn between_the_feet_is_supported_and_a_metre_away_is_not() {
        let origin = Skeleton::nominal(1.77).t_pose_m().map(Vector3::from);
        let pose = Pose::new(origin, [UnitQuaternion::identity(); SEGMENTS]);
        assert!(is_supported(&pose, [0.05, 0.0], 1.77, 0.0));
        assert!(is_supported(&pose, [0.15, 0.1], 1.77, 0.0));
        for outside in [[0.4, 0.0], [-0.2, 0.0], [0.05, 0.4], [0.05, -0.4]] {
            assert!(!is_supported(&pose, outside, 1.77, 0.02), "{outside:?}");
        }
    }
}
