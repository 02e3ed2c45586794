//! Segment positions from a pelvis position and 23 rotations.

use equipoise_core::body::{SEGMENTS, Segment};
use nalgebra::{UnitQuaternion, Vector3};

use crate::person::Person;

/// `world_from_segment` of every segment.
pub type Rotations = [UnitQuaternion<f64>; SEGMENTS];

/// Segment origins (proximal joint centres) in the world, m.
pub fn origins_m(
    person: &Person,
    pelvis_m: Vector3<f64>,
    world_from_segment: &Rotations,
) -> [Vector3<f64>; SEGMENTS] {
    chain_m(&person.offset_m, pelvis_m, world_from_segment)
}

/// The same for given segment lengths: each segment's origin from its parent's, parent's axes, m.
pub fn chain_m(
    bone_m: &[Vector3<f64>; SEGMENTS],
    pelvis_m: Vector3<f64>,
    world_from_segment: &Rotations,
) -> [Vector3<f64>; SEGMENTS] {
    let mut origin_m = [pelvis_m; SEGMENTS];
    for segment in Segment::ALL {
        if let Some(parent) = segment.parent() {
            origin_m[segment.index()] =
                origin_m[parent.index()] + world_from_segment[parent.index()] * bone_m[segment.index()];
        }
    }
    origin_m
}

/// Forward rotations of the tree: input `world_from_pelvis` first, then `parent_from_segment` of each.
pub fn down_the_tree(parent_from_segment: &Rotations) -> Rotations {
    let mut world_from_segment = *parent_from_segment;
    for segment in Segment::ALL {
        if let Some(parent) = segment.parent() {
            world_from_segment[segment.index()] =
                world_from_segment[parent.index()] * parent_from_segment[segment.index()];
        }
    }
    world_from_segment
}

/// The reverse of [`down_the_tree`].
pub fn relative_to_parents(world_from_segment: &Rotations) -> Rotations {
    let mut parent_from_segment = *world_from_segment;
    for segment in Segment::ALL {
        if let Some(parent) = segment.parent() {
            parent_from_segment[segment.index()] =
                world_from_segment[parent.index()].inverse() * world_from_segment[segment.index()];
        }
    }
    parent_from_segment
}

/// Centres of mass of the segments in the world, m; `com_m` as in [`Person::com_m`].
pub fn coms_m(
    com_m: &[Vector3<f64>; SEGMENTS],
    origin_m: &[Vector3<f64>; SEGMENTS],
    world_from_segment: &Rotations,
) -> [Vector3<f64>; SEGMENTS] {
    std::array::from_fn(|i| origin_m[i] + world_from_segment[i] * com_m[i])
}

/// Mass-weighted mean of points.
pub fn centre_m(mass_kg: &[f64], point_m: &[Vector3<f64>]) -> Vector3<f64> {
    let moment: Vector3<f64> = mass_kg.iter().zip(point_m).map(|(mass, point)| point * *mass).sum();
    moment / mass_kg.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_t_pose_has_its_arms_to_the_sides_and_its_toes_in_front() {
        let person = Person::nominal(1.8, 75.0);
        let origin = origins_m(&person, Vector3::zeros(), &[UnitQuaternion::identity(); SEGMENTS]);
        assert!(origin[Segment::LeftHand.index()].y > 0.6);
        assert!(origin[Segment::RightHand.index()].y < -0.6);
        assert!(origin[Segment::LeftToe.index()].x > 0.1);
        assert!(origin[Segment::Head.index()].z > 0.6);
    }

    #[test]
    fn up_the_tree_undoes_down_the_tree() {
        let relative: Rotations = std::array::from_fn(|i| {
            UnitQuaternion::from_scaled_axis(Vector3::new(0.1, -0.2, 0.3) * (i as f64 * 0.1))
        });
        let back = relative_to_parents(&down_the_tree(&relative));
        for (a, b) in relative.iter().zip(&back) {
            assert!(a.angle_to(b) < 1e-7);
        }
    }
}
