//! Why a datagram of the suit did not become part of a sample.

use crate::counts::refusals;
use crate::wire::mvn::Malformed;

refusals! {
    /// Why something the suit sent was not used.
    pub enum SuitRefusal {
        /// Shorter than a header.
        TooShort = "too_short",
        /// Does not begin with `MXTP`.
        NotMvn = "not_mvn",
        /// Cut off, or longer than announced.
        Length = "length",
        /// The payload is not as many items as announced.
        Items = "items",
        /// Counts inside the payload lie.
        Content = "content",
        /// A text is not readable.
        Text = "text",
        /// A type that we do not read.
        UnknownType = "unknown_type",
        /// Another character, or a tracked object.
        OtherAvatar = "other_avatar",
        /// Came from an address that may not send, or a second one.
        ForeignSender = "foreign_sender",
        /// The same counter and type again.
        Duplicate = "duplicate",
        /// Overtaken by a later sample, or a jump of the counter that is not believed yet.
        OutOfOrder = "out_of_order",
        /// A type that we did not know to expect came after its sample was published.
        Late = "late",
        /// NaN or infinity.
        NotFinite = "not_finite",
        /// One segment twice.
        DuplicateSegment = "duplicate_segment",
        /// Not all 23 segments, or not all 22 joints.
        MissingSegment = "missing_segment",
        /// A quaternion whose norm is not 1.
        NotUnitQuaternion = "not_unit_quaternion",
        /// Joints in another order than MVN's.
        UnknownJoint = "unknown_joint",
        /// Head and pelvis are not above the feet: does type 02 have Y up (then `suit.up = "y"`), or is the person lying?
        UpsideDown = "upside_down",
        /// A whole sample without a pose: types 02, 01 and 05 are all off in the Network Streamer, or were lost.
        NoPose = "no_pose",
        /// A sample that went out without a type that its neighbours have: a datagram of it was lost.
        Incomplete = "incomplete",
        /// A number that no body has: a flipped bit that checksums did not see, or a sender gone astray.
        Implausible = "implausible",
        /// A byte stream (TCP) that was out of step: bytes were skipped up to the next datagram.
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
