//! A pose to hold, independent of the body: joint rotations and a name for people.

use nalgebra::{UnitQuaternion, Vector3};

use crate::body::{JOINTS, SEGMENTS, Segment, Skeleton};
use crate::frame::{Pose, StationWorld};

/// A feasible, balanced pose of the library, facing X.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posture {
    /// Instruction for the worker, for example "lean forward, right arm up".
    pub name: &'static str,
    /// Rotation vectors (axis times angle), whole degrees: `world_from_pelvis` first, then `parent_from_segment`.
    pub rotation_deg: [[i16; 3]; SEGMENTS],
}

impl Posture {
    /// `parent_from_segment` of every joint.
    pub fn joint_rotations(&self) -> [UnitQuaternion<f64>; JOINTS] {
        core::array::from_fn(|joint| rotation_of(self.rotation_deg[joint + 1]))
    }

    /// `world_from_segment` of every segment.
    pub fn world_from_segment(&self) -> [UnitQuaternion<f64>; SEGMENTS] {
        let mut rotation = [UnitQuaternion::identity(); SEGMENTS];
        for segment in Segment::ALL {
            let parent_from_segment = rotation_of(self.rotation_deg[segment.index()]);
            rotation[segment.index()] = match segment.parent() {
                Some(parent) => rotation[parent.index()] * parent_from_segment,
                None => parent_from_segment,
            };
        }
        rotation
    }
}

fn rotation_of(rotation_deg: [i16; 3]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(Vector3::from(
        rotation_deg.map(|degrees| f64::from(degrees).to_radians()),
    ))
}

/// The pose of a posture for a body with this skeleton, with the origin of the pelvis at `pelvis_m`.
pub fn pose_of(posture: &Posture, skeleton: &Skeleton, pelvis_m: [f64; 3]) -> Pose<StationWorld> {
    let world_from_segment = posture.world_from_segment();
    let mut origin = [Vector3::from(pelvis_m); SEGMENTS];
    for segment in Segment::ALL {
        if let Some(parent) = segment.parent() {
            let along = Vector3::from(skeleton.offset_m[segment.index()]);
            origin[segment.index()] = origin[parent.index()] + world_from_segment[parent.index()] * along;
        }
    }
    Pose::new(origin, world_from_segment)
}
