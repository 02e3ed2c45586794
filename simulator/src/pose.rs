//! An intended pose: the upper body and the height of the pelvis. The legs follow.

use equipoise_core::body::{Segment, Side};
use equipoise_core::pose_suggestion::Posture;
use nalgebra::{UnitQuaternion, Vector3};

use crate::kinematics::Rotations;
use crate::person::Person;
use crate::random::Random;
use crate::stance::Stance;

/// An intended pose, without the legs: the feet stay in place and balance determines them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// `world_from_pelvis` first, then `parent_from_segment`; the entries of the legs are not used.
    pub parent_from_segment: Rotations,
    /// Height of the pelvis over its height on straight legs; 1 is standing, 0.6 a deep squat.
    pub pelvis_height: f64,
}

impl Pose {
    /// A posture of the library for `person`: its upper body, and the pelvis at the height that its legs give.
    pub fn of_posture(posture: &Posture, person: &Person) -> Pose {
        let parent_from_segment = posture.rotation_deg.map(|degrees| {
            UnitQuaternion::from_scaled_axis(Vector3::from(degrees.map(|d| f64::from(d).to_radians())))
        });
        let world_from_segment = posture.world_from_segment();
        let pelvis_m = Side::BOTH.map(|side| {
            let [upper, lower, foot, _] = Stance::leg(side).map(Segment::index);
            let hip = world_from_segment[0] * person.offset_m[upper];
            let knee = hip + world_from_segment[upper] * person.offset_m[lower];
            let ankle = knee + world_from_segment[lower] * person.offset_m[foot];
            person.ankle_height_m - ankle.z
        });
        let pelvis_height = 0.5 * (pelvis_m[0] + pelvis_m[1]) / straight_height_m(person);
        Pose { parent_from_segment, pelvis_height }
    }

    /// Adds an error of this standard deviation, rad, to each joint of the upper body.
    pub fn add_errors(&mut self, sigma_rad: f64, random: &mut Random) {
        for rotation in &mut self.parent_from_segment[..Segment::RightUpperLeg.index()] {
            let error = Vector3::from_fn(|_, _| sigma_rad / 3.0_f64.sqrt() * random.normal());
            *rotation *= UnitQuaternion::from_scaled_axis(error);
        }
    }

    /// Interpolates by `s` towards another pose: each joint rotates about one axis.
    #[must_use]
    pub fn towards(&self, other: &Pose, s: f64) -> Pose {
        let turn = |i: usize| {
            let (from, to) = (self.parent_from_segment[i], other.parent_from_segment[i]);
            from * (from.inverse() * to).powf(s)
        };
        Pose {
            parent_from_segment: std::array::from_fn(turn),
            pelvis_height: self.pelvis_height + s * (other.pelvis_height - self.pelvis_height),
        }
    }
}

/// Height of the pelvis on straight, upright legs, m.
pub fn straight_height_m(person: &Person) -> f64 {
    let [upper, lower, foot, _] = Stance::leg(Side::Left).map(Segment::index);
    person.ankle_height_m - person.offset_m[upper].z - person.offset_m[lower].z - person.offset_m[foot].z
}
