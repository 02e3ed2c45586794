//! The 24-byte header of every MVN datagram (MVN protocol, "Header").

use super::Malformed;
use crate::wire::reader::Reader;

/// Bytes before the payload.
pub const HEADER_SIZE: usize = 24;
pub(super) const MAGIC: [u8; 4] = *b"MXTP";

/// A datagram's type: the two ASCII digits after `MXTP`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct DatagramType(pub [u8; 2]);

impl DatagramType {
    /// 01: poses as Euler angles, centimetres, Y up.
    pub const POSE_EULER: Self = Self(*b"01");
    /// 02: poses as quaternions, metres, Z up.
    pub const POSE_QUATERNION: Self = Self(*b"02");
    /// 03: the virtual marker set; not used.
    pub const VIRTUAL_MARKERS: Self = Self(*b"03");
    /// 05: poses for Unity3D.
    pub const UNITY: Self = Self(*b"05");
    /// 12: the character's name and other properties.
    pub const META: Self = Self(*b"12");
    /// 13: the null pose and the points on the segments.
    pub const SCALE: Self = Self(*b"13");
    /// 20: joint angles.
    pub const JOINT_ANGLES: Self = Self(*b"20");
    /// 21: positions, velocities and accelerations of the segments.
    pub const LINEAR_KINEMATICS: Self = Self(*b"21");
    /// 22: orientations, angular velocities and accelerations of the segments.
    pub const ANGULAR_KINEMATICS: Self = Self(*b"22");
    /// 23: measurements of each motion tracker; not used.
    pub const TRACKER_KINEMATICS: Self = Self(*b"23");
    /// 24: the whole body's centre of mass.
    pub const CENTRE_OF_MASS: Self = Self(*b"24");
    /// 25: the time of day; not used.
    pub const TIME_CODE: Self = Self(*b"25");
}

impl core::fmt::Display for DatagramType {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}", self.0.escape_ascii())
    }
}

/// Header of every datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Type of the payload. Encoders set it.
    pub datagram_type: DatagramType,
    /// Count of the suit's samples, not of the sent ones: a sender may skip some.
    pub sample_counter: u32,
    /// Number of the datagram within its type and sample: low 7 bits from 0; bit 7 marks the last. A single one is
    /// `0x80`.
    pub datagram_counter: u8,
    /// Items in this datagram. Encoders set it.
    pub items: u8,
    /// Milliseconds since the stream's clock started.
    pub time_code_ms: u32,
    /// Number of the character (avatar), from 0. A tracked object is a character of its own.
    pub avatar: u8,
    /// Body segments, 23. Meaningful in types 01, 02, 21 and 22 from MVN 2019 on, as the next two.
    pub body_segments: u8,
    /// Props, 0 to 4.
    pub props: u8,
    /// Finger segments of both hands together, 0 or 40.
    pub finger_segments: u8,
    /// Bytes after the header. Encoders set it.
    pub payload_size: u16,
}

impl Header {
    /// The header of the only datagram of its type in a sample: a body of 23 segments, no props, no gloves.
    ///
    /// Encoders set type, number of items and payload size.
    pub const fn new(sample_counter: u32, time_code_ms: u32, avatar: u8) -> Header {
        Header {
            datagram_type: DatagramType(*b"00"),
            sample_counter,
            datagram_counter: 0x80,
            items: 0,
            time_code_ms,
            avatar,
            body_segments: 23,
            props: 0,
            finger_segments: 0,
            payload_size: 0,
        }
    }

    /// Parses the header only, without the payload, for splitting a byte stream into datagrams.
    ///
    /// # Errors
    /// [`Malformed::TooShort`] or [`Malformed::NotMvn`].
    pub fn parse(bytes: &[u8]) -> Result<Header, Malformed> {
        let too_short = Malformed::TooShort { length: bytes.len() };
        let (head, _) = bytes.split_first_chunk::<HEADER_SIZE>().ok_or(too_short)?;
        Header::read(&mut Reader::new(head)).ok_or(too_short)?.ok_or(Malformed::NotMvn)
    }

    /// Header and payload of one complete datagram.
    ///
    /// # Errors
    /// A [`Malformed`] if the magic is wrong or the length differs from the header's.
    pub fn split(bytes: &[u8]) -> Result<(Header, &[u8]), Malformed> {
        let header = Header::parse(bytes)?;
        let payload = bytes.get(HEADER_SIZE..).unwrap_or_default();
        let announced = usize::from(header.payload_size);
        if announced == 0 || announced != payload.len() {
            return Err(Malformed::Length { announced, actual: payload.len() });
        }
        Ok((header, payload))
    }

    /// Outer `None`: too few bytes; inner: not `MXTP`.
    fn read(reader: &mut Reader<'_>) -> Option<Option<Header>> {
        if reader.array::<4>()? != MAGIC {
            return Some(None);
        }
        let datagram_type = DatagramType(reader.array()?);
        let sample_counter = reader.u32()?;
        let [datagram_counter, items] = reader.array()?;
        let time_code_ms = reader.u32()?;
        let [avatar, body_segments, props, finger_segments] = reader.array()?;
        let _reserved = reader.u16()?;
        let payload_size = reader.u16()?;
        Some(Some(Header {
            datagram_type,
            sample_counter,
            datagram_counter,
            items,
            time_code_ms,
            avatar,
            body_segments,
            props,
            finger_segments,
            payload_size,
        }))
    }

    /// Kinds of the items of a pose or of kinematics (types 01, 02, 21, 22), by the header's own counts.
    ///
    /// `None` for other types, for senders older than MVN 2019, and if the counts do not sum to the items: then only
    /// the segment ids, which number the body from 1 to 23, are available.
    pub fn layout(&self) -> Option<Layout> {
        const WITH_COUNTS: [DatagramType; 4] = [
            DatagramType::POSE_EULER,
            DatagramType::POSE_QUATERNION,
            DatagramType::LINEAR_KINEMATICS,
            DatagramType::ANGULAR_KINEMATICS,
        ];
        let Header { body_segments: body, props, finger_segments: fingers, .. } = *self;
        let items = u16::from(body) + u16::from(props) + u16::from(fingers);
        let adds_up = body > 0 && items == u16::from(self.items) && WITH_COUNTS.contains(&self.datagram_type);
        adds_up.then_some(Layout { body, props, fingers })
    }

    fn to_bytes(self) -> [u8; HEADER_SIZE] {
        let mut bytes = [0; HEADER_SIZE];
        bytes[0..4].copy_from_slice(&MAGIC);
        bytes[4..6].copy_from_slice(&self.datagram_type.0);
        bytes[6..10].copy_from_slice(&self.sample_counter.to_be_bytes());
        bytes[10] = self.datagram_counter;
        bytes[11] = self.items;
        bytes[12..16].copy_from_slice(&self.time_code_ms.to_be_bytes());
        bytes[16..20].copy_from_slice(&[self.avatar, self.body_segments, self.props, self.finger_segments]);
        bytes[22..24].copy_from_slice(&self.payload_size.to_be_bytes());
        bytes
    }
}

/// Count of items of each kind in a datagram; they are in this order, fingers of the left hand first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Segments of the body.
    pub body: u8,
    /// Props. Their ids follow the body's (24 …), and fingers' ids shift with them: use the order instead.
    pub props: u8,
    /// Finger segments of both hands.
    pub fingers: u8,
}

/// More items or bytes than a header can announce.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{items} items in {payload} bytes do not fit one datagram (255 items, 65535 bytes); split them")]
pub struct Oversized {
    /// Count of items.
    pub items: usize,
    /// Count of bytes.
    pub payload: usize,
}

/// Replaces the contents of `out` with one datagram: the completed header, and the payload that `write_payload`
/// appends.
pub(super) fn frame(
    header: &Header,
    datagram_type: DatagramType,
    items: usize,
    out: &mut Vec<u8>,
    write_payload: impl FnOnce(&mut Vec<u8>),
) -> Result<(), Oversized> {
    out.clear();
    out.resize(HEADER_SIZE, 0);
    write_payload(out);
    let payload = out.len() - HEADER_SIZE;
    let oversized = Oversized { items, payload };
    let completed = Header {
        datagram_type,
        items: u8::try_from(items).map_err(|_| oversized)?,
        payload_size: u16::try_from(payload).map_err(|_| oversized)?,
        ..*header
    };
    out[..HEADER_SIZE].copy_from_slice(&completed.to_bytes());
    Ok(())
}

// bytes    object
// 0–3      "MXTP"
// 4–5      datagram_type, two ASCII digits
// 6–9      sample_counter u32
// 10       datagram_counter u8
// 11       items u8
// 12–15    time_code_ms u32
// 16       avatar u8
// 17       body_segments u8
// 18       props u8
// 19       finger_segments u8
// 20–21    reserved, zero
// 22–23    payload_size u16

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(
            sample_counter: u32, datagram_counter: u8, items: u8, time_code_ms: u32, avatar: u8, props: u8, payload_size: u16,
        ) {
            let header = Header {
                datagram_type: DatagramType::SCALE, datagram_counter, items, props, payload_size,
                ..Header::new(sample_counter, time_code_ms, avatar)
            };
            prop_assert_eq!(Header::parse(&header.to_bytes()), Ok(header));
        }
    }

    #[test]
    fn counts_are_accepted_if_consistent() {
        let gloves = Header {
            datagram_type: DatagramType::POSE_QUATERNION,
            items: 65,
            props: 2,
            finger_segments: 40,
            ..Header::new(1, 4, 0)
        };
        assert_eq!(gloves.layout(), Some(Layout { body: 23, props: 2, fingers: 40 }));
        assert_eq!(Header { items: 64, ..gloves }.layout(), None);
        assert_eq!(Header { datagram_type: DatagramType::JOINT_ANGLES, ..gloves }.layout(), None);
        let old = Header { items: 23, body_segments: 0, props: 0, finger_segments: 0, ..gloves };
        assert_eq!(old.layout(), None, "reserved before MVN 2019");
    }

    #[test]
    fn too_much_for_one_datagram_is_refused() {
        let mut out = Vec::new();
        let header = Header::new(0, 0, 0);
        assert!(frame(&header, DatagramType::META, 256, &mut out, |_| ()).is_err());
        assert!(frame(&header, DatagramType::META, 1, &mut out, |out| out.resize(70_000, 0)).is_err());
    }
}
