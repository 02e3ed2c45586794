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
    pub(super) const COUNT: usize = 6;

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
            Part::Pose { from_euler: true, .. } => TypeSet::POSE_EULER,
            Part::Pose { from_euler: false, .. } => TypeSet::POSE_QUATERNION,
            Part::Linear { .. } => TypeSet::LINEAR_KINEMATICS,
            Part::Angular { .. } => TypeSet::ANGULAR_KINEMATICS,
            Part::Joints { .. } => TypeSet::JOINT_ANGLES,
            Part::Com { .. } => TypeSet::CENTRE_OF_MASS,
        }
    }

    pub(super) fn has_pose(self) -> bool {
        self.has(TypeSet::POSE_QUATERNION) || self.has(TypeSet::POSE_EULER)
    }
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
    /// Constant part of the delay from a sample to its datagram, ns: the clock fit cannot see it, so it is taken off
    /// every sample time.
    pub latency_ns: u64,
}

impl Default for SuitSettings {
    fn default() -> Self {
        SuitSettings { avatar: 0, required: None, check_up_axis: true, latency_ns: 0 }
    }
}
