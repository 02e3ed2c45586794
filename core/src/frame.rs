//! Poses whose type contains their frame.
//!
//! The suit world drifts against the floor by centimetres per minute; the station world is the floor with the force
//! plate in it. Only [`crate::anchor`] converts one into the other, so the compiler rejects a pose in the drifting
//! frame:
//!
//! ```compile_fail
//! use equipoise_core::{frame::{Pose, SuitWorld}, sesc};
//! fn centre(pose: &Pose<SuitWorld>, phi: &sesc::Phi) {
//!     sesc::centre_of_mass(pose, phi); // expected `Pose<StationWorld>`
//! }
//! ```

use core::marker::PhantomData;

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};

use crate::body::{SEGMENTS, Segment, Side, Skeleton};
use crate::math;

/// The suit world: Z up, with a drifting origin.
#[derive(Debug, Clone, Copy)]
pub enum SuitWorld {}

/// The station world: X forward, Y left, Z up; the plate's position in it is configured.
#[derive(Debug, Clone, Copy)]
pub enum StationWorld {}

/// Positions and orientations of all segments, in world `W`.
#[derive(Debug, Clone, Copy)]
pub struct Pose<W> {
    /// Segment origins (proximal joint centres), m.
    pub origin: [Vector3<f64>; SEGMENTS],
    /// `world_from_segment` of every segment.
    pub world_from_segment: [UnitQuaternion<f64>; SEGMENTS],
    world: PhantomData<W>,
}

impl<W> Pose<W> {
    /// Constructs a pose.
    pub fn new(
        origin: [Vector3<f64>; SEGMENTS],
        world_from_segment: [UnitQuaternion<f64>; SEGMENTS],
    ) -> Self {
        Pose { origin, world_from_segment, world: PhantomData }
    }

    /// Segment origin, m.
    pub fn origin_of(&self, segment: Segment) -> Vector3<f64> {
        self.origin[segment.index()]
    }

    /// A point fixed in a segment, in world coordinates, m.
    pub fn point_on(&self, segment: Segment, from_origin_m: [f64; 3]) -> Vector3<f64> {
        let index = segment.index();
        self.origin[index] + self.world_from_segment[index] * Vector3::from(from_origin_m)
    }

    /// A segment's origin from another's, in the other's axes, m.
    pub fn offset_in(&self, other: Segment, segment: Segment) -> Vector3<f64> {
        let along = self.origin_of(segment) - self.origin_of(other);
        self.world_from_segment[other.index()].inverse() * along
    }

    /// Origins of all segments from these orientations along constant bones, with the middle of the feet in its place,
    /// m.
    pub fn origins_along(&self, skeleton: &Skeleton) -> [Vector3<f64>; SEGMENTS] {
        let origin = skeleton.origins_m(&self.world_from_segment);
        let between_feet = |origin: &[Vector3<f64>; SEGMENTS]| {
            let [left, right] = Side::BOTH.map(|side| origin[side.foot().index()]);
            0.5 * (left + right)
        };
        let shift = between_feet(&self.origin) - between_feet(&origin);
        origin.map(|origin| origin + shift)
    }

    /// The pose halfway between the reported origins and those along constant bones.
    #[must_use]
    pub fn halfway_along(&self, skeleton: &Skeleton) -> Self {
        let along_bones = self.origins_along(skeleton);
        let origin = core::array::from_fn(|segment| 0.5 * (self.origin[segment] + along_bones[segment]));
        Pose::new(origin, self.world_from_segment)
    }

    /// `parent_from_segment` of every joint.
    pub fn joint_rotations(&self) -> [UnitQuaternion<f64>; SEGMENTS - 1] {
        core::array::from_fn(|joint| {
            let segment = Segment::ALL[joint + 1];
            let world_from_child = self.world_from_segment[segment.index()];
            match segment.parent() {
                Some(parent) => self.world_from_segment[parent.index()].inverse() * world_from_child,
                None => world_from_child,
            }
        })
    }
}

impl Pose<SuitWorld> {
    /// The same pose with the origin of its world shifted.
    pub fn shifted(&self, station_from_suit_m: Vector3<f64>) -> Pose<StationWorld> {
        Pose::new(self.origin.map(|origin| origin + station_from_suit_m), self.world_from_segment)
    }
}

impl Pose<StationWorld> {
    /// The same pose at another position, world x and y, m.
    #[must_use]
    pub fn displaced(&self, [x, y]: [f64; 2]) -> Pose<StationWorld> {
        let by = Vector3::new(x, y, 0.0);
        Pose::new(self.origin.map(|origin| origin + by), self.world_from_segment)
    }
}

/// A rotation about the vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    cos: f64,
    sin: f64,
}

impl Turn {
    /// A rotation to the left, rad.
    pub fn by(angle_rad: f64) -> Turn {
        let (sin, cos) = math::sin_cos(angle_rad);
        Turn { cos, sin }
    }

    /// Rotates a horizontal vector.
    pub fn of(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.cos * x - self.sin * y, self.sin * x + self.cos * y]
    }

    /// Rotates a vector.
    pub fn of_vector(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [x, y] = self.of([x, y]);
        [x, y, z]
    }

    /// Rotates an orientation, a unit quaternion with the scalar first.
    pub fn of_wxyz(self, orientation_wxyz: [f64; 4]) -> [f64; 4] {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), math::atan2(self.sin, self.cos));
        wxyz(&(turn * rotation(orientation_wxyz)))
    }
}

/// A unit quaternion from its message form, scalar first.
pub fn rotation([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    Unit::new_unchecked(Quaternion::new(w, x, y, z))
}

/// The message form of a unit quaternion, scalar first.
pub fn wxyz(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    [rotation.w, rotation.i, rotation.j, rotation.k]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halfway_is_the_same_for_constant_bones_and_halves_a_change_of_one() {
        let skeleton = Skeleton::nominal(1.8);
        let turns = core::array::from_fn(|index| {
            UnitQuaternion::from_euler_angles(0.02 * index as f64, -0.03 * index as f64, 0.01)
        });
        let there = Vector3::new(0.4, -0.2, 1.0);
        let pose = Pose::<StationWorld>::new(skeleton.origins_m(&turns).map(|origin| origin + there), turns);
        let furthest_m = |a: &Pose<StationWorld>, b: &Pose<StationWorld>| {
            let apart = a.origin.iter().zip(&b.origin).map(|(a, b)| (a - b).norm());
            apart.fold(0.0, f64::max)
        };
        assert!(furthest_m(&pose.halfway_along(&skeleton), &pose) < 1e-12);
        let mut raised = pose;
        for segment in Segment::ALL.into_iter().filter(|segment| segment.is_distal_to(Segment::T8)) {
            raised.origin[segment.index()].z += 0.02;
        }
        let halfway = raised.halfway_along(&skeleton);
        assert!((furthest_m(&halfway, &pose) - 0.01).abs() < 1e-12);
        assert!((furthest_m(&halfway, &raised) - 0.01).abs() < 1e-12);
        assert_eq!(halfway.origin_of(Segment::LeftFoot), pose.origin_of(Segment::LeftFoot));
    }
}
