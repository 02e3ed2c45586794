//! Type 20: joint angles (MVN protocol, "Joint angles").
//!
//! 22 joints in the order of `equipoise_core::body::Joint`, then up to 6 ergonomic joints, of which two have the same
//! pair of ids: use the order, not the ids.

use super::header::{DatagramType, Header, Oversized};
use super::items::{self, Item};
use crate::wire::reader::{Reader, write_f32s};

/// The `(parent_point, child_point)` of the 22 joints of the body, in the order of `equipoise_core::body::Joint::ALL`.
pub const BODY_JOINT_POINTS: [(u32, u32); 22] = [
    (0x0102, 0x0201),
    (0x0202, 0x0301),
    (0x0302, 0x0401),
    (0x0402, 0x0501),
    (0x0502, 0x0601),
    (0x0602, 0x0701),
    (0x0503, 0x0801),
    (0x0802, 0x0901),
    (0x0902, 0x0a01),
    (0x0a02, 0x0b01),
    (0x0504, 0x0c01),
    (0x0c02, 0x0d01),
    (0x0d02, 0x0e01),
    (0x0e02, 0x0f01),
    (0x0103, 0x1001),
    (0x1002, 0x1101),
    (0x1102, 0x1201),
    (0x1202, 0x1301),
    (0x0104, 0x1401),
    (0x1402, 0x1501),
    (0x1502, 0x1601),
    (0x1602, 0x1701),
];

/// One joint's angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointAngle {
    /// Point on the proximal segment: 256 × segment id + local point id.
    pub parent_point: u32,
    /// Point on the distal segment, likewise.
    pub child_point: u32,
    /// Abduction, axial rotation, flexion; degrees (Euler ZXY, ISB axes).
    pub angle_deg: [f32; 3],
}

impl Item for JointAngle {
    const DATAGRAM_TYPE: DatagramType = DatagramType::JOINT_ANGLES;
    const SIZE: usize = 20;

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(JointAngle {
            parent_point: reader.u32()?,
            child_point: reader.u32()?,
            angle_deg: reader.f32s()?,
        })
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.parent_point.to_be_bytes());
        out.extend_from_slice(&self.child_point.to_be_bytes());
        write_f32s(&self.angle_deg, out);
    }
}

/// Replaces the contents of `out` with one datagram of type 20; joints in MVN's order (see [`BODY_JOINT_POINTS`]).
///
/// # Errors
/// [`Oversized`] for more than 255 items.
pub fn encode(header: &Header, items: &[JointAngle], out: &mut Vec<u8>) -> Result<(), Oversized> {
    items::encode(header, items, out)
}

// bytes    object (each item)
// 0–3      parent_point u32
// 4–7      child_point u32
// 8–19     angle_deg 3 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(values in proptest::collection::vec((any::<u32>(), any::<u32>(), proptest::array::uniform3(-180f32..180.0)), 1..64)) {
            let written: Vec<_> = values.into_iter().map(|(parent, child, v)| JointAngle { parent_point: parent, child_point: child, angle_deg: v }).collect();
            let mut bytes = Vec::new();
            encode(&Header::new(7, 29, 1), &written, &mut bytes).unwrap();
            prop_assert_eq!(bytes.len(), 24 + 20 * written.len());
            let Ok(Datagram::JointAngles(header, items)) = Datagram::parse(&bytes) else { panic!("not read back") };
            prop_assert_eq!((header.sample_counter, header.avatar, items.len()), (7, 1, written.len()));
            prop_assert_eq!(items.collect::<Vec<_>>(), written);
        }
    }
}
