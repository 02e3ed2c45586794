//! The body as a tree: segments in MVN order, the joints between them, and each segment's parent.
//!
//! Source of order, ids and parents: Xsens MVN network protocol (segment table; joint list of datagram 20).

pub mod anthropometry;
pub mod gyration;
pub mod skeleton;

pub use anthropometry::{Anthropometry, Sex};
pub use gyration::gyration_m2;
pub use skeleton::Skeleton;

/// Number of body segments.
pub const SEGMENTS: usize = 23;
/// Number of joints: joint `j` is the proximal joint of segment `j + 1`, since only the pelvis has no parent.
pub const JOINTS: usize = SEGMENTS - 1;

/// A body segment. The number is the index in every array; MVN's segment id is one more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
#[expect(missing_docs, reason = "the names are those of MVN")]
pub enum Segment {
    Pelvis,
    L5,
    L3,
    T12,
    T8,
    Neck,
    Head,
    RightShoulder,
    RightUpperArm,
    RightForearm,
    RightHand,
    LeftShoulder,
    LeftUpperArm,
    LeftForearm,
    LeftHand,
    RightUpperLeg,
    RightLowerLeg,
    RightFoot,
    RightToe,
    LeftUpperLeg,
    LeftLowerLeg,
    LeftFoot,
    LeftToe,
}

use Segment::{
    Head, L3, L5, LeftFoot, LeftForearm, LeftHand, LeftLowerLeg, LeftShoulder, LeftToe, LeftUpperArm,
    LeftUpperLeg, Neck, Pelvis, RightFoot, RightForearm, RightHand, RightLowerLeg, RightShoulder, RightToe,
    RightUpperArm, RightUpperLeg, T8, T12,
};

impl Segment {
    /// All segments in index order.
    pub const ALL: [Segment; SEGMENTS] = [
        Pelvis,
        L5,
        L3,
        T12,
        T8,
        Neck,
        Head,
        RightShoulder,
        RightUpperArm,
        RightForearm,
        RightHand,
        LeftShoulder,
        LeftUpperArm,
        LeftForearm,
        LeftHand,
        RightUpperLeg,
        RightLowerLeg,
        RightFoot,
        RightToe,
        LeftUpperLeg,
        LeftLowerLeg,
        LeftFoot,
        LeftToe,
    ];

    /// Index in arrays.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The parent segment; the pelvis has none.
    pub const fn parent(self) -> Option<Segment> {
        Some(match self {
            Pelvis => return None,
            L5 | RightUpperLeg | LeftUpperLeg => Pelvis,
            L3 => L5,
            T12 => L3,
            T8 => T12,
            Neck | RightShoulder | LeftShoulder => T8,
            Head => Neck,
            RightUpperArm => RightShoulder,
            RightForearm => RightUpperArm,
            RightHand => RightForearm,
            LeftUpperArm => LeftShoulder,
            LeftForearm => LeftUpperArm,
            LeftHand => LeftForearm,
            RightLowerLeg => RightUpperLeg,
            RightFoot => RightLowerLeg,
            RightToe => RightFoot,
            LeftLowerLeg => LeftUpperLeg,
            LeftFoot => LeftLowerLeg,
            LeftToe => LeftFoot,
        })
    }

    /// The joint that connects it to its parent.
    pub const fn proximal_joint(self) -> Option<Joint> {
        match self.index() {
            0 => None,
            index => Some(Joint::ALL[index - 1]),
        }
    }

    /// The same segment on the other side; itself on the midline.
    pub const fn mirrored(self) -> Segment {
        match self {
            RightShoulder => LeftShoulder,
            RightUpperArm => LeftUpperArm,
            RightForearm => LeftForearm,
            RightHand => LeftHand,
            RightUpperLeg => LeftUpperLeg,
            RightLowerLeg => LeftLowerLeg,
            RightFoot => LeftFoot,
            RightToe => LeftToe,
            LeftShoulder => RightShoulder,
            LeftUpperArm => RightUpperArm,
            LeftForearm => RightForearm,
            LeftHand => RightHand,
            LeftUpperLeg => RightUpperLeg,
            LeftLowerLeg => RightLowerLeg,
            LeftFoot => RightFoot,
            LeftToe => RightToe,
            midline => midline,
        }
    }

    /// Whether `self` is `root` or a descendant of it.
    pub const fn is_distal_to(self, root: Segment) -> bool {
        let mut segment = self;
        loop {
            if segment.index() == root.index() {
                return true;
            }
            match segment.parent() {
                Some(parent) => segment = parent,
                None => return false,
            }
        }
    }

    /// MVN's name, as in null-pose datagrams and recordings.
    pub const fn name(self) -> &'static str {
        SEGMENT_NAMES[self.index()]
    }
}

const SEGMENT_NAMES: [&str; SEGMENTS] = [
    "Pelvis",
    "L5",
    "L3",
    "T12",
    "T8",
    "Neck",
    "Head",
    "RightShoulder",
    "RightUpperArm",
    "RightForearm",
    "RightHand",
    "LeftShoulder",
    "LeftUpperArm",
    "LeftForearm",
    "LeftHand",
    "RightUpperLeg",
    "RightLowerLeg",
    "RightFoot",
    "RightToe",
    "LeftUpperLeg",
    "LeftLowerLeg",
    "LeftFoot",
    "LeftToe",
];

/// The joint between a segment and its parent; `Joint(j)` belongs to segment `j + 1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Joint(u8);

const JOINT_NAMES: [&str; JOINTS] = [
    "L5S1",
    "L4L3",
    "L1T12",
    "T9T8",
    "T1C7",
    "C1Head",
    "RightT4Shoulder",
    "RightShoulder",
    "RightElbow",
    "RightWrist",
    "LeftT4Shoulder",
    "LeftShoulder",
    "LeftElbow",
    "LeftWrist",
    "RightHip",
    "RightKnee",
    "RightAnkle",
    "RightBallFoot",
    "LeftHip",
    "LeftKnee",
    "LeftAnkle",
    "LeftBallFoot",
];

impl Joint {
    /// All joints in index order (the order of MVN's datagram 20).
    pub const ALL: [Joint; JOINTS] = {
        let mut all = [Joint(0); JOINTS];
        let mut index = 0;
        while index < JOINTS {
            all[index] = Joint(index as u8);
            index += 1;
        }
        all
    };

    /// Index in arrays.
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// The segment distal of the joint.
    pub const fn segment(self) -> Segment {
        Segment::ALL[self.index() + 1]
    }

    /// MVN's name of the joint.
    pub const fn name(self) -> &'static str {
        JOINT_NAMES[self.index()]
    }

    /// The joint with this name.
    pub fn named(name: &str) -> Option<Joint> {
        Joint::ALL.into_iter().find(|joint| joint.name() == name)
    }
}

/// Left or right.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "left is left")]
pub enum Side {
    Left,
    Right,
}

impl Side {
    /// Both, in the order of two-element arrays of messages: left first.
    pub const BOTH: [Side; 2] = [Side::Left, Side::Right];

    /// The hand of that side.
    pub const fn hand(self) -> Segment {
        match self {
            Side::Left => LeftHand,
            Side::Right => RightHand,
        }
    }

    /// The lower leg of that side.
    pub const fn lower_leg(self) -> Segment {
        match self {
            Side::Left => LeftLowerLeg,
            Side::Right => RightLowerLeg,
        }
    }

    /// The foot of that side.
    pub const fn foot(self) -> Segment {
        match self {
            Side::Left => LeftFoot,
            Side::Right => RightFoot,
        }
    }

    /// The toes of that side.
    pub const fn toe(self) -> Segment {
        match self {
            Side::Left => LeftToe,
            Side::Right => RightToe,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parents_come_before_their_children() {
        for segment in Segment::ALL {
            assert!(segment.parent().is_none_or(|parent| parent < segment));
            assert_eq!(Segment::ALL[segment.index()], segment);
        }
    }

    #[test]
    fn mirroring_twice_is_nothing_and_keeps_the_tree() {
        for segment in Segment::ALL {
            assert_eq!(segment.mirrored().mirrored(), segment);
            assert_eq!(segment.mirrored().parent(), segment.parent().map(Segment::mirrored));
        }
    }

    #[test]
    fn joints_have_the_names_of_their_segments() {
        assert_eq!(Joint::named("RightElbow").map(Joint::segment), Some(RightForearm));
        assert_eq!(Joint::named("LeftHip").map(Joint::segment), Some(LeftUpperLeg));
        assert_eq!(L5.proximal_joint().map(Joint::name), Some("L5S1"));
        assert_eq!(Pelvis.proximal_joint(), None);
    }

    #[test]
    fn hands_hang_on_the_trunk_and_feet_do_not() {
        assert!(LeftHand.is_distal_to(T8) && LeftHand.is_distal_to(LeftHand));
        assert!(!LeftFoot.is_distal_to(T8) && LeftFoot.is_distal_to(Pelvis));
    }
}
