//! The pose to take, drawn on this worker: the same stature, standing where the worker stands.

use std::borrow::Cow;

use equipoise_core::body::{SEGMENTS, Segment, Side, Skeleton};
use equipoise_core::pose_suggestion::{Posture, posture::pose_of};
use nalgebra::{Rotation3, Vector3};
use serde::Serialize;

/// A suggested pose, ready to be drawn.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SuggestedPose {
    /// What to tell the worker.
    pub name: Cow<'static, str>,
    /// Segment origins in the station's world, m.
    pub segment_origin_m: [[f64; 3]; SEGMENTS],
}

impl SuggestedPose {
    /// `posture` with the worker's stature: its feet are in the middle of those of `worker_origin_m` and have their
    /// heading.
    pub fn on_the_spot(posture: &Posture, worker_origin_m: &[[f64; 3]; SEGMENTS]) -> SuggestedPose {
        let skeleton = Skeleton::nominal(height_m(worker_origin_m));
        let origin = pose_of(posture, &skeleton, [0.0; 3]).origin;
        let (suggested, worker) = (Stance::of(&origin), Stance::of(&worker_origin_m.map(Vector3::from)));
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), worker.heading_rad - suggested.heading_rad);
        SuggestedPose {
            name: Cow::Borrowed(posture.name),
            segment_origin_m: origin.map(|point| (turn * (point - suggested.spot) + worker.spot).into()),
        }
    }
}

/// Stature by the lengths of all bones, which no pose changes: good enough for drawing any wearer. 1.7 m before
/// the first pose.
pub(crate) fn height_m(origin_m: &[[f64; 3]; SEGMENTS]) -> f64 {
    const NOMINAL_M: f64 = 1.7;
    let bones_m = |origin_m: &[[f64; 3]; SEGMENTS]| -> f64 {
        let at = |segment: Segment| Vector3::from(origin_m[segment.index()]);
        let to_parent = |segment: Segment| segment.parent().map(|parent| (at(segment) - at(parent)).norm());
        Segment::ALL.into_iter().filter_map(to_parent).sum()
    };
    let worker_m = bones_m(origin_m);
    if worker_m > 0.0 {
        NOMINAL_M * worker_m / bones_m(&Skeleton::nominal(NOMINAL_M).t_pose_m())
    } else {
        NOMINAL_M
    }
}

/// Where somebody stands: the point midway between the ankles at the height of the lower one, and where the feet point.
struct Stance {
    spot: Vector3<f64>,
    heading_rad: f64,
}

impl Stance {
    fn of(origin: &[Vector3<f64>; SEGMENTS]) -> Stance {
        let [left, right] = Side::BOTH.map(|side| origin[side.foot().index()]);
        let forward: Vector3<f64> =
            Side::BOTH.iter().map(|side| origin[side.toe().index()] - origin[side.foot().index()]).sum();
        let middle = 0.5 * (left + right);
        Stance {
            spot: Vector3::new(middle.x, middle.y, left.z.min(right.z)),
            // atan2(0, 0) is 0: feet without a heading face X.
            heading_rad: forward.y.atan2(forward.x),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UPRIGHT: Posture = Posture { name: "upright", rotation_deg: [[0; 3]; SEGMENTS] };

    #[test]
    fn the_workers_own_pose_suggested_is_the_worker() {
        // The stature is that of the bones, not a configured one.
        let skeleton = Skeleton::nominal(1.93);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 2.0);
        let worker = pose_of(&UPRIGHT, &skeleton, [0.0; 3])
            .origin
            .map(|point| <[f64; 3]>::from(turn * point + Vector3::new(0.4, -0.2, 0.95)));
        let suggested = SuggestedPose::on_the_spot(&UPRIGHT, &worker);
        for (a, b) in suggested.segment_origin_m.iter().zip(&worker) {
            assert!((Vector3::from(*a) - Vector3::from(*b)).norm() < 1e-12);
        }
    }

    #[test]
    fn without_a_pose_of_the_worker_the_suggested_pose_is_at_the_origin() {
        let suggested = SuggestedPose::on_the_spot(&UPRIGHT, &[[0.0; 3]; SEGMENTS]);
        assert!(suggested.segment_origin_m.as_flattened().iter().all(|metres| metres.abs() < 2.0));
    }
}
