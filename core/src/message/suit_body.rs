//! Body dimensions from the suit's software: null pose and foot points.

use nalgebra::Vector3;

use super::layout::{ZeroCopySend, message};
use crate::body::{SEGMENTS, Segment, Side, Skeleton};

/// Number of points per foot, in the order of [`FootPoint`].
pub const FOOT_POINTS: usize = 4;

message! {
    /// Subject's dimensions from the suit's software (MVN type 13); published once per second, and on a change.
    ///
    /// Null pose: upright, arms at the sides, the axes of all segments parallel to the world's (X forward, Y left, Z
    /// up). Only the suit adapter publishes it.
    as "equipoise/SuitBody/1", 832 bytes,
    pub struct SuitBody {
        /// Kernel's receive stamp of the datagram with the last change, CLOCK_MONOTONIC ns.
        pub arrival_ns: u64,
        /// Time of publication by the adapter, CLOCK_MONOTONIC ns; unique within a station.
        pub published_ns: u64,
        /// Character ID in MVN.
        pub avatar: u32,
        /// Session of the suit's counter: `SuitSample::session`.
        pub session: u32,
        /// Points received of the left and the right foot: a union of [`FootPoint`] bits. Other points are zero and
        /// invalid.
        pub foot_points: [u32; 2],
        /// Segment origins (proximal joint centres) in the null pose, MVN order, m.
        pub origin_m: [[f64; 3]; SEGMENTS],
        /// Points of the left and the right foot relative to the foot segment's origin, m: heel, first and fifth
        /// metatarsal, toe tip.
        pub foot_point_m: [[[f64; 3]; FOOT_POINTS]; 2],
        /// Always zero; pads the message to a multiple of 64 bytes.
        pub reserved_tail: [u64; 7],
    }
}

/// The points of a foot, as bits of `foot_points`; the place in the table is the bit's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
/// Points of a foot, as bits of `foot_points`; the index in the table is that of the bit.
pub enum FootPoint {
    /// Back of the heel.
    Heel = 1,
    /// Ball of the foot at the big toe.
    FirstMetatarsal = 1 << 1,
    /// Ball of the foot at the little toe.
    FifthMetatarsal = 1 << 2,
    /// Tip of the toes.
    ToeTip = 1 << 3,
}

/// Maximum size of a person in any direction, m.
const REACH_MAX_M: f64 = 4.0;
/// Maximum distance of a point of the foot from the ankle, m.
const FOOT_MAX_M: f64 = 0.5;
/// Range of the head's height above the feet of a standing person, m.
const STATURE_M: core::ops::RangeInclusive<f64> = 0.8..=2.6;

impl SuitBody {
    /// A point of a foot relative to the foot segment's origin, m; `None` if it was not sent.
    pub fn foot_point_m(&self, side: Side, point: FootPoint) -> Option<Vector3<f64>> {
        let foot = side as usize;
        let sent = self.foot_points[foot] & point as u32 != 0;
        sent.then(|| Vector3::from(self.foot_point_m[foot][(point as u32).trailing_zeros() as usize]))
    }

    /// Segment offsets; in the null pose a parent's axes are the world's.
    pub fn skeleton(&self) -> Skeleton {
        let origin = |segment: Segment| Vector3::from(self.origin_m[segment.index()]);
        Skeleton {
            offset_m: Segment::ALL.map(|segment| {
                segment.parent().map_or([0.0; 3], |parent| (origin(segment) - origin(parent)).into())
            }),
        }
    }

    /// Whether the dimensions are possible for an upright person. Every comparison is false for NaN.
    pub fn is_plausible(&self) -> bool {
        let height_m = |segment: Segment| self.origin_m[segment.index()][2];
        let sides =
            |left: Segment, right: Segment| self.origin_m[left.index()][1] > self.origin_m[right.index()][1];
        self.origin_m.iter().flatten().all(|metres| metres.abs() < REACH_MAX_M)
            && self.foot_point_m.iter().flatten().flatten().all(|metres| metres.abs() < FOOT_MAX_M)
            && Side::BOTH
                .iter()
                .all(|side| STATURE_M.contains(&(height_m(Segment::Head) - height_m(side.foot()))))
            && sides(Segment::LeftUpperLeg, Segment::RightUpperLeg)
            && sides(Segment::LeftUpperArm, Segment::RightUpperArm)
    }

    /// Whether both have the same dimensions, character and session, regardless of their times.
    pub fn has_same_dimensions(&self, other: &SuitBody) -> bool {
        *self == SuitBody { arrival_ns: self.arrival_ns, published_ns: self.published_ns, ..*other }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn body() -> SuitBody {
        let origin_m = Skeleton::nominal(1.77).t_pose_m().map(|[x, y, z]| [x, y, z + 0.95]);
        SuitBody { origin_m, ..Zeroable::zeroed() }
    }

    #[test]
    fn the_bones_of_the_null_pose_are_those_it_was_made_of() {
        let (made, nominal) = (body().skeleton(), Skeleton::nominal(1.77));
        for (made, nominal) in made.offset_m.iter().flatten().zip(nominal.offset_m.iter().flatten()) {
            assert!((made - nominal).abs() < 1e-12);
        }
    }

    #[test]
    fn a_point_that_was_not_sent_is_none() {
        let mut body = body();
        body.foot_points[1] = FootPoint::ToeTip as u32;
        body.foot_point_m[1][3] = [0.2, 0.0, -0.08];
        assert_eq!(body.foot_point_m(Side::Right, FootPoint::ToeTip), Some(Vector3::new(0.2, 0.0, -0.08)));
        assert_eq!(body.foot_point_m(Side::Right, FootPoint::Heel), None);
        assert_eq!(body.foot_point_m(Side::Left, FootPoint::ToeTip), None);
    }

    #[test]
    fn an_impossible_body_is_refused() {
        assert!(body().is_plausible());
        let is_sound_after = |corrupt: &dyn Fn(&mut SuitBody)| {
            let mut body = body();
            corrupt(&mut body);
            body.is_plausible()
        };
        assert!(!is_sound_after(&|body| body.origin_m[4][2] = f64::NAN));
        assert!(!is_sound_after(&|body| body.origin_m = [[0.0; 3]; SEGMENTS]), "everything in one place");
        assert!(
            !is_sound_after(&|body| body.origin_m.iter_mut().for_each(|[_, y, z]| core::mem::swap(y, z))),
            "lying"
        );
        assert!(
            !is_sound_after(&|body| body.origin_m.iter_mut().for_each(|[_, y, _]| *y = -*y)),
            "sides exchanged"
        );
        assert!(
            !is_sound_after(&|body| body.origin_m.iter_mut().flatten().for_each(|metres| *metres *= 100.0)),
            "cm"
        );
        assert!(!is_sound_after(&|body| body.foot_point_m[0][0] = [0.0, 0.0, -9.0]));
    }

    #[test]
    fn the_same_build_sent_again_is_the_same() {
        let again = SuitBody { published_ns: 9, arrival_ns: 8, ..body() };
        assert!(again.has_same_dimensions(&body()));
        assert!(!again.has_same_dimensions(&SuitBody { session: 1, ..body() }));
    }
}
