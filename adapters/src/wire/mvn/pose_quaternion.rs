//! Type 02: segment poses as quaternions (MVN protocol, "Segment position and orientation, quaternion").
//!
//! The specification says centimetres; real datagrams contain **metres** (they equal type 01 of the same sample).

use super::header::{DatagramType, Header, Oversized};
use super::items::{self, Item};
use crate::wire::reader::{Reader, write_f32s};

/// One segment's pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentPose {
    /// MVN segment id, from 1: index plus one for the 23 of the body.
    pub segment_id: u32,
    /// Segment origin (proximal joint centre) in the suit's world: X forward, Y left, Z up; m.
    pub position_m: [f32; 3],
    /// `suitworld_from_segment`, scalar first; unit norm except for rounding, sign arbitrary.
    pub orientation_wxyz: [f32; 4],
}

impl SegmentPose {
    /// Converts the pose from a world whose Y points up (X left, Y up, Z forward), as in type 01.
    #[must_use]
    pub fn y_up_to_z_up(&self) -> SegmentPose {
        let [w, x, y, z] = self.orientation_wxyz;
        SegmentPose {
            segment_id: self.segment_id,
            position_m: y_up_to_z_up(self.position_m),
            orientation_wxyz: [w, z, x, y],
        }
    }
}

/// Converts a vector of a right-handed world whose Y points up to the world whose Z points up: left, up, forward become
/// forward, left, up.
pub const fn y_up_to_z_up([left, up, forward]: [f32; 3]) -> [f32; 3] {
    [forward, left, up]
}

impl Item for SegmentPose {
    const DATAGRAM_TYPE: DatagramType = DatagramType::POSE_QUATERNION;
    const SIZE: usize = 32;

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(SegmentPose {
            segment_id: reader.u32()?,
            position_m: reader.f32s()?,
            orientation_wxyz: reader.f32s()?,
        })
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.segment_id.to_be_bytes());
        write_f32s(&self.position_m, out);
        write_f32s(&self.orientation_wxyz, out);
    }
}

/// Replaces the contents of `out` with one datagram of type 02; body first, then props, left fingers, right fingers.
///
/// # Errors
/// [`Oversized`] for more than 255 items.
pub fn encode(header: &Header, items: &[SegmentPose], out: &mut Vec<u8>) -> Result<(), Oversized> {
    items::encode(header, items, out)
}

// bytes    object (each item)
// 0–3      segment_id u32
// 4–15     position_m 3 × f32
// 16–31    orientation_wxyz 4 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(values in proptest::collection::vec((any::<u32>(), proptest::array::uniform7(-1e3f32..1e3)), 1..64)) {
            let written: Vec<_> = values.into_iter().map(|(id, v)| SegmentPose { segment_id: id, position_m: [v[0], v[1], v[2]], orientation_wxyz: [v[3], v[4], v[5], v[6]] }).collect();
            let mut bytes = Vec::new();
            encode(&Header::new(7, 29, 1), &written, &mut bytes).unwrap();
            prop_assert_eq!(bytes.len(), 24 + 32 * written.len());
            let Ok(Datagram::PoseQuaternion(header, items)) = Datagram::parse(&bytes) else { panic!("not read back") };
            prop_assert_eq!((header.sample_counter, header.avatar, items.len()), (7, 1, written.len()));
            prop_assert_eq!(items.collect::<Vec<_>>(), written);
        }
    }
}
