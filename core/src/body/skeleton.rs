//! Bone lengths of the body: segment origins in their parents.

use nalgebra::{UnitQuaternion, Vector3};

use super::{SEGMENTS, Segment};
use crate::frame::Pose;

/// Each segment's origin from its parent's origin, in the parent's axes, m; the pelvis has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Skeleton {
    /// Indexed by [`Segment`].
    pub offset_m: [[f64; 3]; SEGMENTS],
}

impl Skeleton {
    /// The skeleton of one pose. It is the same in every pose of a rigid body, so it can be averaged over poses.
    pub fn of<W>(pose: &Pose<W>) -> Skeleton {
        Skeleton {
            offset_m: Segment::ALL.map(|segment| match segment.parent() {
                None => [0.0; 3],
                Some(parent) => pose.offset_in(parent, segment).into(),
            }),
        }
    }

    /// Proportions of an MVN null pose, scaled to a stature; for drawing a pose that has not been performed.
    pub fn nominal(height_m: f64) -> Skeleton {
        let mut offset_m = [[0.0; 3]; SEGMENTS];
        for (segment, [x, y, z]) in NOMINAL {
            offset_m[segment.index()] = [x * height_m, y * height_m, z * height_m];
            offset_m[segment.mirrored().index()] = [x * height_m, -y * height_m, z * height_m];
        }
        Skeleton { offset_m }
    }

    /// Segment origins in the T-pose with the pelvis at zero, m.
    pub fn t_pose_m(&self) -> [[f64; 3]; SEGMENTS] {
        self.origins_m(&[UnitQuaternion::identity(); SEGMENTS]).map(Into::into)
    }

    /// Segment origins for these orientations with the pelvis at zero, m.
    pub fn origins_m(
        &self,
        world_from_segment: &[UnitQuaternion<f64>; SEGMENTS],
    ) -> [Vector3<f64>; SEGMENTS] {
        let mut origin = [Vector3::zeros(); SEGMENTS];
        for segment in Segment::ALL {
            if let Some(parent) = segment.parent() {
                let bone_m = Vector3::from(self.offset_m[segment.index()]);
                origin[segment.index()] =
                    origin[parent.index()] + world_from_segment[parent.index()] * bone_m;
            }
        }
        origin
    }

    /// The largest difference between two bones' lengths, m.
    pub fn differs_by_m(&self, other: &Skeleton) -> f64 {
        let differs = |segment| (self.length_m(segment) - other.length_m(segment)).abs();
        Segment::ALL.map(differs).into_iter().fold(0.0, f64::max)
    }

    /// Distance of a segment's origin from its parent's, m.
    pub fn length_m(&self, segment: Segment) -> f64 {
        Vector3::from(self.offset_m[segment.index()]).norm()
    }
}

/// Offsets over stature, left side and midline; the right side mirrors them.
const NOMINAL: [(Segment, [f64; 3]); 14] = [
    (Segment::L5, [-0.0065, 0.0, 0.058]),
    (Segment::L3, [0.0, 0.0, 0.065]),
    (Segment::T12, [0.0, 0.0, 0.060]),
    (Segment::T8, [0.0, 0.0, 0.060]),
    (Segment::Neck, [0.0, 0.0, 0.083]),
    (Segment::Head, [0.0, 0.0, 0.055]),
    (Segment::LeftShoulder, [0.0, 0.018, 0.0465]),
    (Segment::LeftUpperArm, [0.0, 0.084, 0.0]),
    (Segment::LeftForearm, [0.0, 0.170, 0.0]),
    (Segment::LeftHand, [0.0, 0.150, 0.0]),
    (Segment::LeftUpperLeg, [0.0, 0.048, 0.0]),
    (Segment::LeftLowerLeg, [0.0, 0.0, -0.245]),
    (Segment::LeftFoot, [0.0, 0.0, -0.246]),
    (Segment::LeftToe, [0.104, 0.0, -0.044]),
];
