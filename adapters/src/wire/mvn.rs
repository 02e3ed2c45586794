//! The MVN network streaming protocol: one datagram is a 24-byte [`Header`] and a payload of one type.
//!
//! Everything is big-endian. Source: "MVN real-time network streaming Protocol Specification"; where it differs from
//! real datagrams (units of type 02, sizes of 24), the datagrams take precedence, as the type's module
//! documents.

pub mod angular_kinematics;
pub mod centre_of_mass;
pub mod header;
mod items;
pub mod joint_angles;
pub mod linear_kinematics;
pub mod meta;
pub mod pose_euler;
pub mod pose_quaternion;
pub mod scale;
pub mod stream;
pub mod unity;

pub use angular_kinematics::AngularKinematics;
pub use centre_of_mass::CentreOfMass;
pub use header::{DatagramType, HEADER_SIZE, Header, Layout, Oversized};
pub use items::Items;
pub use joint_angles::JointAngle;
pub use linear_kinematics::LinearKinematics;
pub use meta::Meta;
pub use pose_euler::EulerPose;
pub use pose_quaternion::SegmentPose;
pub use scale::{NullPoseSegment, Scale, SegmentPoint};
pub use stream::{Cut, StreamCutter};
pub use unity::UnityBody;

/// MVN's default destination port (9 = X, 6 = M, 3 = E).
pub const DEFAULT_PORT: u16 = 9763;

/// One datagram, decoded if its type is supported. Borrows the bytes; nothing is copied or allocated.
#[derive(Debug, Clone, Copy)]
#[expect(missing_docs, reason = "the types of the payloads say all there is to say")]
pub enum Datagram<'a> {
    PoseEuler(Header, Items<'a, EulerPose>),
    PoseQuaternion(Header, Items<'a, SegmentPose>),
    Unity(Header, UnityBody<'a>),
    Meta(Header, Meta<'a>),
    Scale(Header, Scale<'a>),
    JointAngles(Header, Items<'a, JointAngle>),
    LinearKinematics(Header, Items<'a, LinearKinematics>),
    AngularKinematics(Header, Items<'a, AngularKinematics>),
    CentreOfMass(Header, CentreOfMass),
    /// Types 03, 23 and 25: known, their payload is not read.
    Unused(Header),
    /// An unsupported type, with a valid header and length.
    Unknown(Header),
    /// JSON text of the remote control, which shares the port; ignored, and not data corruption.
    Json,
}

impl<'a> Datagram<'a> {
    /// Parses one datagram.
    ///
    /// Accepted only if its length is header plus payload size, and the payload matches the type and the number of
    /// items.
    ///
    /// # Errors
    /// A [`Malformed`] that describes the fault.
    pub fn parse(bytes: &'a [u8]) -> Result<Datagram<'a>, Malformed> {
        if bytes.first() == Some(&b'{') {
            return Ok(Datagram::Json);
        }
        let (header, payload) = Header::split(bytes)?;
        Ok(match header.datagram_type {
            DatagramType::POSE_EULER => Datagram::PoseEuler(header, Items::parse(&header, payload)?),
            DatagramType::POSE_QUATERNION => {
                Datagram::PoseQuaternion(header, Items::parse(&header, payload)?)
            }
            DatagramType::UNITY => Datagram::Unity(header, UnityBody::parse(&header, payload)?),
            DatagramType::META => Datagram::Meta(header, Meta::parse(payload)?),
            DatagramType::SCALE => Datagram::Scale(header, Scale::parse(payload)?),
            DatagramType::JOINT_ANGLES => Datagram::JointAngles(header, Items::parse(&header, payload)?),
            DatagramType::LINEAR_KINEMATICS => {
                Datagram::LinearKinematics(header, Items::parse(&header, payload)?)
            }
            DatagramType::ANGULAR_KINEMATICS => {
                Datagram::AngularKinematics(header, Items::parse(&header, payload)?)
            }
            DatagramType::CENTRE_OF_MASS => Datagram::CentreOfMass(header, CentreOfMass::parse(payload)?),
            DatagramType::VIRTUAL_MARKERS | DatagramType::TRACKER_KINEMATICS | DatagramType::TIME_CODE => {
                Datagram::Unused(header)
            }
            _ => Datagram::Unknown(header),
        })
    }

    /// The header; JSON text has none.
    pub fn header(&self) -> Option<&Header> {
        match self {
            Datagram::PoseEuler(header, _)
            | Datagram::PoseQuaternion(header, _)
            | Datagram::Unity(header, _)
            | Datagram::Meta(header, _)
            | Datagram::Scale(header, _)
            | Datagram::JointAngles(header, _)
            | Datagram::LinearKinematics(header, _)
            | Datagram::AngularKinematics(header, _)
            | Datagram::CentreOfMass(header, _)
            | Datagram::Unused(header)
            | Datagram::Unknown(header) => Some(header),
            Datagram::Json => None,
        }
    }
}

/// Why bytes are not an MVN datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// Shorter than a header.
    #[error("{length} bytes are fewer than the 24 of an MVN header; something else sends to this port")]
    TooShort {
        /// Bytes received.
        length: usize,
    },
    /// The first four bytes are not `MXTP`.
    #[error("the datagram does not begin with \"MXTP\"; something else sends to this port")]
    NotMvn,
    /// Header and datagram disagree on the length.
    #[error(
        "the header announces a payload of {announced} bytes, {actual} came; was the datagram cut off, or is \
             the sender older than MVN 2018?"
    )]
    Length {
        /// Payload size by the header.
        announced: usize,
        /// Bytes after the header.
        actual: usize,
    },
    /// The payload is not as many items as announced.
    #[error("type {datagram_type}: {items} items do not make a payload of {payload} bytes")]
    Items {
        /// The datagram's type.
        datagram_type: DatagramType,
        /// Items by the header.
        items: u8,
        /// Payload size, bytes.
        payload: usize,
    },
    /// A count or a length inside the payload points beyond its end, or bytes remain.
    #[error("type {datagram_type}: the payload does not end where its {field} says")]
    Content {
        /// The datagram's type.
        datagram_type: DatagramType,
        /// The field at fault.
        field: &'static str,
    },
    /// A text is not UTF-8, or not in the format of its type.
    #[error("type {datagram_type}: its {field} is not readable text")]
    Text {
        /// The datagram's type.
        datagram_type: DatagramType,
        /// The field at fault.
        field: &'static str,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_input_panics(mut bytes in proptest::collection::vec(any::<u8>(), 0..300), kind in 0..30u8, is_framed: bool) {
            if is_framed && bytes.len() > HEADER_SIZE {
                let size = (bytes.len() - HEADER_SIZE) as u16;
                bytes[..6].copy_from_slice(format!("MXTP{kind:02}").as_bytes());
                bytes[22..24].copy_from_slice(&size.to_be_bytes());
            }
            if let Ok(Datagram::Scale(_, scale)) = Datagram::parse(&bytes) {
                prop_assert!(scale.segments().count() + scale.points().count() < 300);
            }
        }
    }

    #[test]
    fn json_is_not_corruption() {
        assert!(matches!(Datagram::parse(br#"{"type":"transport"}"#), Ok(Datagram::Json)));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        assert_eq!(Datagram::parse(b"MXTP02").unwrap_err(), Malformed::TooShort { length: 6 });
        assert_eq!(Datagram::parse(&[7; 60]).unwrap_err(), Malformed::NotMvn);
        let mut bytes = Vec::new();
        let pose =
            SegmentPose { segment_id: 1, position_m: [0.0; 3], orientation_wxyz: [1.0, 0.0, 0.0, 0.0] };
        pose_quaternion::encode(&Header::new(1, 4, 0), &[pose; 23], &mut bytes).unwrap();
        assert_eq!(bytes.len(), 760);
        assert!(matches!(Datagram::parse(&bytes), Ok(Datagram::PoseQuaternion(..))));
        assert_eq!(
            Datagram::parse(&bytes[..700]).unwrap_err(),
            Malformed::Length { announced: 736, actual: 676 }
        );
        bytes[11] = 22;
        assert_eq!(
            Datagram::parse(&bytes).unwrap_err(),
            Malformed::Items { datagram_type: DatagramType::POSE_QUATERNION, items: 22, payload: 736 }
        );
        bytes[4..6].copy_from_slice(b"77");
        assert!(matches!(Datagram::parse(&bytes), Ok(Datagram::Unknown(_))));
    }
}
