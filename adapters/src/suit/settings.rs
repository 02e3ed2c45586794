//! Settings of the assembler.

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
    /// The types that contain a pose, the best first: 01 is 02 rounded through angles, 05 a chain of 23 products.
    const POSES: [TypeSet; 3] = [TypeSet::POSE_QUATERNION, TypeSet::POSE_EULER, TypeSet::POSE_UNITY];

    /// Union of both sets.
    #[must_use]
    pub const fn and(self, other: TypeSet) -> TypeSet {
        TypeSet(self.0 | other.0)
    }

    /// Whether the set contains all of `other`.
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

    /// Whether the set contains a better pose than that of type `pose`; never if `pose` is no pose type.
    pub(super) fn has_better_pose_than(self, pose: TypeSet) -> bool {
        let rank = Self::POSES.into_iter().position(|one| one == pose).unwrap_or(0);
        Self::POSES[..rank].iter().any(|better| self.has(*better))
    }
}

/// The upward axis of the suit's world, in type 02; other types define it themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// X forward, Y left, Z up: MVN's default.
    #[default]
    Z,
    /// X left, Y up, Z forward. The world of types 22 and 24 is unverified in this case, so they are not used; that of
    /// type 21 follows from its positions.
    Y,
}

/// Settings of the suit's stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SuitSettings {
    /// The character to use; others share the port.
    pub avatar: u8,
    /// The types to wait for; `None` determines them from the stream.
    pub required: Option<TypeSet>,
    /// Refuse poses in which neither head nor pelvis is above the feet (a stream that is not Z up, a person lying).
    pub check_up_axis: bool,
    /// The upward axis in type 02.
    pub up: UpAxis,
    /// Constant part of the delay from a sample to its datagram, ns: unobservable for the clock fit, so it is
    /// subtracted from every sample time.
    pub latency_ns: u64,
}

impl Default for SuitSettings {
    fn default() -> Self {
        SuitSettings { avatar: 0, required: None, check_up_axis: true, up: UpAxis::Z, latency_ns: 0 }
    }
}
