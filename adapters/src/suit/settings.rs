//! What the assembler is told to expect.

use super::part::Part;

/// A set of the datagram types that go into a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TypeSet(u8);

impl TypeSet {
    /// Type 01.
    pub const POSE_EULER: TypeSet = TypeSet(1);
    /// Type 02.
    pub const POSE_QUATERNION: TypeSet = TypeSet(1 << 1);
    /// Type 20.
    pub const JOINT_ANGLES: TypeSet = TypeSet(1 << 2);
    /// Type 21.
    pub const LINEAR_KINEMATICS: TypeSet = TypeSet(1 << 3);
    /// Type 22.
    pub const ANGULAR_KINEMATICS: TypeSet = TypeSet(1 << 4);
    /// Type 24.
    pub const CENTRE_OF_MASS: TypeSet = TypeSet(1 << 5);
    /// Type 05.
    pub const POSE_UNITY: TypeSet = TypeSet(1 << 6);
    pub(super) const COUNT: usize = 7;
    /// The types that carry a pose, the best first: 01 is 02 rounded through angles, 05 a chain of 23 products.
    const POSES: [TypeSet; 3] = [TypeSet::POSE_QUATERNION, TypeSet::POSE_EULER, TypeSet::POSE_UNITY];

    /// Both sets together.
    #[must_use]
    pub const fn and(self, other: TypeSet) -> TypeSet {
        TypeSet(self.0 | other.0)
    }

    /// Whether all of `other` is in it.
    pub const fn has(self, other: TypeSet) -> bool {
        self.0 & other.0 == other.0
    }

    pub(super) const fn bit(index: usize) -> TypeSet {
        TypeSet(1 << index)
    }

    #[must_use]
    pub(super) const fn without(self, other: TypeSet) -> TypeSet {
        TypeSet(self.0 & !other.0)
    }

    pub(super) fn of(part: &Part) -> TypeSet {
        match part {
            Part::Pose { kind, .. } => *kind,
            Part::Linear { .. } => TypeSet::LINEAR_KINEMATICS,
            Part::Angular { .. } => TypeSet::ANGULAR_KINEMATICS,
            Part::Joints { .. } => TypeSet::JOINT_ANGLES,
            Part::Com { .. } => TypeSet::CENTRE_OF_MASS,
        }
    }

    pub(super) fn has_pose(self) -> bool {
        Self::POSES.into_iter().any(|pose| self.has(pose))
    }

    /// Whether a pose is in it that is better than that of type `pose`; never if `pose` is none.
    pub(super) fn has_better_pose_than(self, pose: TypeSet) -> bool {
        let rank = Self::POSES.into_iter().position(|one| one == pose).unwrap_or(0);
        Self::POSES[..rank].iter().any(|better| self.has(*better))
    }
}

/// Which axis of the suit's world points up, in type 02; other types say so themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// X forward, Y left, Z up: what MVN sends unless told otherwise.
    #[default]
    Z,
    /// X left, Y up, Z forward. In which world types 22 and 24 come then was never seen, so they are not used; type 21
    /// shows by its positions.
    Y,
}

/// What to expect of the suit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SuitSettings {
    /// The character to follow; others share the port.
    pub avatar: u8,
    /// The types to wait for; `None` to learn them from the stream.
    pub required: Option<TypeSet>,
    /// Refuse poses in which neither head nor pelvis is above the feet (a stream that is not Z up, a person lying).
    pub check_up_axis: bool,
    /// The axis that points up in type 02.
    pub up: UpAxis,
    /// Constant part of the delay from a sample to its datagram, ns: the clock fit cannot see it, so it is taken off
    /// every sample time.
    pub latency_ns: u64,
}

impl Default for SuitSettings {
    fn default() -> Self {
        SuitSettings { avatar: 0, required: None, check_up_axis: true, up: UpAxis::Z, latency_ns: 0 }
    }
}
