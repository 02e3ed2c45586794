//! Intended posture of the upper body in clinical joint angles, and the resulting pose.

use equipoise_core::body::{SEGMENTS, Segment};
use nalgebra::{UnitQuaternion, Vector3};

use crate::pose::Pose;

/// One arm relative to the trunk; the same numbers mirror on the other side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arm {
    /// Angle of the upper arm from hanging down: 0 down, 90 level, 170 up.
    pub elevation_deg: f64,
    /// The plane in which it is raised: 0 to the side, 90 to the front.
    pub forward_deg: f64,
    /// Outward rotation about the long axis.
    pub outward_deg: f64,
    /// Flexion of the elbow.
    pub elbow_deg: f64,
}

impl Arm {
    /// Hanging at the side, a hand's breadth from the thigh.
    pub const DOWN: Arm = Arm { elevation_deg: 10.0, forward_deg: 0.0, outward_deg: 0.0, elbow_deg: 8.0 };

    /// `parent_from_segment` of shoulder, upper arm and forearm. `side`: 1 left, −1 right.
    fn rotations(&self, side: f64) -> [UnitQuaternion<f64>; 3] {
        // The shoulder girdle contributes to the elevation above 30°.
        let girdle = 0.15 * (self.elevation_deg - 30.0).max(0.0);
        let about =
            |axis: Vector3<f64>, degrees: f64| UnitQuaternion::from_scaled_axis(axis * degrees.to_radians());
        let (x, y, z) = (Vector3::x() * side, Vector3::y(), Vector3::z() * side);
        let whole =
            about(z, -self.forward_deg) * about(x, self.elevation_deg - 90.0) * about(y, -self.outward_deg);
        let shoulder = about(x, girdle);
        [shoulder, shoulder.inverse() * whole, about(z, -self.elbow_deg)]
    }
}

/// An intention for the whole upper body. Angles in degrees; forward, right and left are relative to the person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intention {
    /// Lowering of the pelvis, as a fraction of its height on straight legs.
    pub pelvis_drop: f64,
    /// Pelvis: forward tilt, lean to the right, rotation to the left.
    pub pelvis_deg: [f64; 3],
    /// Flexion of the spine, forward.
    pub trunk_flex_deg: f64,
    /// Bend of the spine to the right.
    pub trunk_side_deg: f64,
    /// Rotation of the spine to the left.
    pub trunk_twist_deg: f64,
    /// Head: nod, tilt to the right, rotation to the left.
    pub head_deg: [f64; 3],
    /// Left arm.
    pub left_arm: Arm,
    /// Right arm.
    pub right_arm: Arm,
    /// Whether both hands are at the sides of a box: then the arms are moved to have them as far apart as it is wide.
    pub at_box: bool,
}

/// Distribution of the spine's bend over its joints, L5S1 up to T9T8.
const SPINE: [(Segment, f64); 4] =
    [(Segment::L5, 0.30), (Segment::L3, 0.30), (Segment::T12, 0.22), (Segment::T8, 0.18)];
const NECK: [(Segment, f64); 2] = [(Segment::Neck, 0.4), (Segment::Head, 0.6)];

impl Intention {
    /// Standing straight with the arms down.
    pub const STAND: Intention = Intention {
        pelvis_drop: 0.0,
        pelvis_deg: [0.0; 3],
        trunk_flex_deg: 0.0,
        trunk_side_deg: 0.0,
        trunk_twist_deg: 0.0,
        head_deg: [0.0; 3],
        left_arm: Arm::DOWN,
        right_arm: Arm::DOWN,
        at_box: false,
    };

    /// Both arms in the same position.
    #[must_use]
    pub const fn arms(self, arm: Arm) -> Intention {
        Intention { left_arm: arm, right_arm: arm, ..self }
    }

    /// Both arms in the same position, with the hands at the sides of a box.
    #[must_use]
    pub const fn at_box(self, arm: Arm) -> Intention {
        Intention { at_box: true, ..self.arms(arm) }
    }

    /// The resulting pose. The width of a box is not considered: [`crate::grasp::hold_box`].
    pub fn pose(&self) -> Pose {
        // World X is the axis of a lean to the right, Y of a tilt forward, Z of a rotation to the left.
        let turn = |[forward, right, left]: [f64; 3], fraction: f64| {
            UnitQuaternion::from_scaled_axis(
                Vector3::new(right, forward, left).map(f64::to_radians) * fraction,
            )
        };
        let mut rotation = [UnitQuaternion::identity(); SEGMENTS];
        rotation[0] = turn(self.pelvis_deg, 1.0);
        let trunk = [self.trunk_flex_deg, self.trunk_side_deg, self.trunk_twist_deg];
        for (segment, fraction) in SPINE {
            rotation[segment.index()] = turn(trunk, fraction);
        }
        for (segment, fraction) in NECK {
            rotation[segment.index()] = turn(self.head_deg, fraction);
        }
        for (start, arm, side) in
            [(Segment::LeftShoulder, self.left_arm, 1.0), (Segment::RightShoulder, self.right_arm, -1.0)]
        {
            for (step, part) in arm.rotations(side).into_iter().enumerate() {
                rotation[start.index() + step] = part;
            }
        }
        Pose { parent_from_segment: rotation, pelvis_height: 1.0 - self.pelvis_drop }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{down_the_tree, origins_m};
    use crate::person::Person;

    fn hand(arm: Arm, hand: Segment) -> Vector3<f64> {
        let pose = Intention::STAND.arms(arm).pose();
        let rotation = down_the_tree(&pose.parent_from_segment);
        let origin = origins_m(&Person::nominal(1.8, 75.0), Vector3::zeros(), &rotation);
        origin[hand.index()] - origin[Segment::T8.index()]
    }

    #[test]
    fn arms_go_where_they_are_meant() {
        let level = Arm { elevation_deg: 90.0, forward_deg: 0.0, outward_deg: 0.0, elbow_deg: 0.0 };
        let (left, right) = (Segment::LeftHand, Segment::RightHand);
        assert!(hand(level, left).y > 0.6 && hand(level, right).y < -0.6);
        let front = Arm { forward_deg: 90.0, ..level };
        assert!(hand(front, left).x > 0.5 && hand(front, right).x > 0.5);
        let up = Arm { elevation_deg: 170.0, ..level };
        assert!(hand(up, left).z > 0.6 && hand(up, right).z > 0.6);
        assert!(hand(Arm::DOWN, left).z < -0.3 && hand(Arm::DOWN, right).z < -0.3);
        // Elbows bent at the side bring the hands to the front; with the arm in front and rotated outwards, up.
        let bent = Arm { elbow_deg: 90.0, ..Arm::DOWN };
        assert!(hand(bent, left).x > 0.2 && hand(bent, right).x > 0.2);
        let flexed = Arm { outward_deg: 90.0, elbow_deg: 90.0, ..front };
        assert!(hand(flexed, left).z > 0.2 && hand(flexed, right).z > 0.2);
    }
}
