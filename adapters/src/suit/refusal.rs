//! Why a datagram of the suit did not become part of a sample.

use crate::counts::refusals;
use crate::wire::mvn::Malformed;

refusals! {
    /// Why input of the suit was not used.
    pub enum SuitRefusal {
        /// Shorter than a header.
        TooShort = "too_short",
        /// Does not begin with `MXTP`.
        NotMvn = "not_mvn",
        /// Truncated, or longer than announced.
        Length = "length",
        /// The payload is not as many items as announced.
        Items = "items",
        /// Counts inside the payload are wrong.
        Content = "content",
        /// A text is not readable.
        Text = "text",
        /// An unsupported type.
        UnknownType = "unknown_type",
        /// Another character, or a tracked object.
        OtherAvatar = "other_avatar",
        /// The sender is not admitted, or is a second one.
        ForeignSender = "foreign_sender",
        /// A duplicate of counter and type.
        Duplicate = "duplicate",
        /// Overtaken by a later sample, or a jump of the counter that is not accepted yet.
        OutOfOrder = "out_of_order",
        /// An unexpected type arrived after its sample was published.
        Late = "late",
        /// NaN or infinity.
        NotFinite = "not_finite",
        /// A duplicate segment.
        DuplicateSegment = "duplicate_segment",
        /// Not all 23 segments, or not all 22 joints.
        MissingSegment = "missing_segment",
        /// A quaternion whose norm is not 1.
        NotUnitQuaternion = "not_unit_quaternion",
        /// Joints in another order than MVN's.
        UnknownJoint = "unknown_joint",
        /// Head and pelvis are not above the feet: does type 02 have Y up (then `suit.up_axis = "y"`), or is the person lying?
        UpsideDown = "upside_down",
        /// A complete sample without a pose: types 02, 01 and 05 are all off in the Network Streamer, or were lost.
        NoPose = "no_pose",
        /// A sample that was published without a type that its neighbours have: a datagram of it was lost.
        Incomplete = "incomplete",
        /// A number that no body has: undetected data corruption, or a faulty sender.
        Implausible = "implausible",
        /// A byte stream (TCP) that lost synchronisation: bytes were skipped up to the next datagram.
        OutOfStep = "out_of_step",
    }
}

impl From<Malformed> for SuitRefusal {
    fn from(malformed: Malformed) -> Self {
        match malformed {
            Malformed::TooShort { .. } => SuitRefusal::TooShort,
            Malformed::NotMvn => SuitRefusal::NotMvn,
            Malformed::Length { .. } => SuitRefusal::Length,
            Malformed::Items { .. } => SuitRefusal::Items,
            Malformed::Content { .. } => SuitRefusal::Content,
            Malformed::Text { .. } => SuitRefusal::Text,
        }
    }
}
