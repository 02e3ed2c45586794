//! Support polygon of the standing feet.

use super::foot_outline::FootOutline;
use crate::anchor::LIFTED_M;
use crate::body::Side;
use crate::frame::{Pose, StationWorld};
use crate::math;

/// Whether a point of the floor lies in the convex hull of the left and the right foot outline, widened by `margin_m`.
///
/// A point is inside if no direction separates it from all corners; 32 directions are accurate to about 2 % of the
/// feet's distance and never reject a point inside.
pub fn is_supported(
    pose: &Pose<StationWorld>,
    point_m: [f64; 2],
    outlines: &[FootOutline; 2],
    margin_m: f64,
) -> bool {
    let [left, right] = Side::BOTH.map(|side| outlines[side as usize].corners_m(pose, side));
    is_in_hull(point_m, left.iter().chain(&right), margin_m)
}

/// Which feet are loaded while the CoP is `cop_m`, world x and y: left, right.
///
/// A foot whose ankle is higher than the other's may still be loaded at its ball. This is certain if the CoP lies
/// outside the lower foot's outline, widened by `margin_m`.
pub fn bearing_feet(
    pose: &Pose<StationWorld>,
    cop_m: [f64; 2],
    outlines: &[FootOutline; 2],
    margin_m: f64,
) -> [bool; 2] {
    let height_m = Side::BOTH.map(|side| pose.origin_of(side.foot()).z);
    core::array::from_fn(|foot| {
        let other = 1 - foot;
        let corners = outlines[other].corners_m(pose, Side::BOTH[other]);
        height_m[foot] - height_m[other] <= LIFTED_M || !is_in_hull(cop_m, corners.iter(), margin_m)
    })
}

fn is_in_hull<'a>(
    point_m: [f64; 2],
    corners: impl Iterator<Item = &'a [f64; 2]> + Clone,
    margin_m: f64,
) -> bool {
    const DIRECTIONS: usize = 32;
    (0..DIRECTIONS).all(|index| {
        let angle = core::f64::consts::TAU * index as f64 / DIRECTIONS as f64;
        let (sine, cosine) = math::sin_cos(angle);
        let along = |point: [f64; 2]| cosine * point[0] + sine * point[1];
        let reach = corners.clone().map(|corner| along(*corner)).fold(f64::NEG_INFINITY, f64::max);
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
        let outlines = Side::BOTH.map(|side| FootOutline::by_stature(&pose, side, 1.77));
        assert!(is_supported(&pose, [0.05, 0.0], &outlines, 0.0));
        assert!(is_supported(&pose, [0.15, 0.1], &outlines, 0.0));
        for outside in [[0.4, 0.0], [-0.2, 0.0], [0.05, 0.4], [0.05, -0.4]] {
            assert!(!is_supported(&pose, outside, &outlines, 0.02), "{outside:?}");
        }
    }

    #[test]
    fn a_raised_heel_carries_weight_unless_the_other_foot_alone_explains_the_centre_of_pressure() {
        let mut pose = standing();
        let outlines = Side::BOTH.map(|side| FootOutline::by_stature(&pose, side, 1.77));
        let [left, right] = Side::BOTH.map(|side| pose.origin_of(side.foot()));
        let feet =
            |pose: &Pose<StationWorld>, y_m: f64| bearing_feet(pose, [left.x + 0.05, y_m], &outlines, 0.02);
        for y_m in [left.y, 0.0, right.y] {
            assert_eq!(feet(&pose, y_m), [true, true], "both stand flat");
        }
        pose.origin[Side::Right.foot().index()].z += 0.08;
        assert_eq!(feet(&pose, left.y), [true, false]);
        assert_eq!(feet(&pose, 0.0), [true, true], "between the feet");
    }

    #[test]
    fn longer_outlines_extend_the_support() {
        let pose = standing();
        let short = Side::BOTH.map(|side| FootOutline::by_stature(&pose, side, 1.77));
        let toe_m = short[0].along_m[1];
        let long = short.map(|outline| FootOutline { along_m: [outline.along_m[0], toe_m + 0.1], ..outline });
        let point_m = [toe_m + 0.05, 0.0];
        assert!(!is_supported(&pose, point_m, &short, 0.0) && is_supported(&pose, point_m, &long, 0.0));
    }
}
