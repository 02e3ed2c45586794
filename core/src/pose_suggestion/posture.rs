//! A pose to hold, independent of who holds it: joint rotations and a name for people.

use nalgebra::{UnitQuaternion, Vector3};

use crate::body::{SEGMENTS, Segment};

/// A feasible, balanced pose of the library, facing X.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posture {
    /// What to tell the worker, for example "lean forward, right arm up".
    pub name: &'static str,
    /// Rotation vectors (axis times angle), whole degrees: `world_from_pelvis` first, then `parent_from_segment`.
    pub rotation_deg: [[i16; 3]; SEGMENTS],
}

impl Posture {
    /// `world_from_segment` of every segment.
    pub fn world_from_segment(&self) -> [UnitQuaternion<f64>; SEGMENTS] {
        let mut rotation = [UnitQuaternion::identity(); SEGMENTS];
        for segment in Segment::ALL {
            let degrees = self.rotation_deg[segment.index()];
            let parent_from_segment =
                UnitQuaternion::from_scaled_axis(Vector3::from(degrees.map(|d| f64::from(d).to_radians())));
            rotation[segment.index()] = match segment.parent() {
                Some(parent) => rotation[parent.index()] * parent_from_segment,
                None => parent_from_segment,
            };
        }
        rotation
    }
}
