//! Type 03: the virtual marker set (MVN protocol, "Point position data, virtual marker set").
//!
//! Points on the body that correspond to markers of optical systems; centimetres, **Y up**: X left, Y up, Z forward.
//! Not verified with a real datagram: layout and units are those of the specification and of the maker's own parser.

use super::header::{DatagramType, Header, Oversized};
use super::items::{self, Item};
use super::pose_quaternion::y_up_to_z_up;
use crate::wire::reader::{Reader, write_f32s};

/// One virtual marker, as transmitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualMarker {
    /// MVN's number of the point.
    pub point_id: u32,
    /// Left, up, forward; cm.
    pub position_cm_y_up: [f32; 3],
}

impl VirtualMarker {
    /// Converts the position to the frame of types 02 and 21: forward, left, up; m.
    pub fn to_z_up_m(&self) -> [f32; 3] {
        y_up_to_z_up(self.position_cm_y_up.map(|cm| cm / 100.0))
    }
}

impl Item for VirtualMarker {
    const DATAGRAM_TYPE: DatagramType = DatagramType::VIRTUAL_MARKERS;
    const SIZE: usize = 16;

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(VirtualMarker { point_id: reader.u32()?, position_cm_y_up: reader.f32s()? })
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.point_id.to_be_bytes());
        write_f32s(&self.position_cm_y_up, out);
    }
}

/// Replaces the contents of `out` with one datagram of type 03.
///
/// # Errors
/// [`Oversized`] for more than 255 markers.
pub fn encode(header: &Header, items: &[VirtualMarker], out: &mut Vec<u8>) -> Result<(), Oversized> {
    items::encode(header, items, out)
}

// bytes    object (each item)
// 0–3      point_id u32
// 4–15     position_cm_y_up 3 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(values in proptest::collection::vec((any::<u32>(), proptest::array::uniform3(-1e3f32..1e3)), 1..64)) {
            let written: Vec<_> = values.into_iter().map(|(point_id, position_cm_y_up)| VirtualMarker { point_id, position_cm_y_up }).collect();
            let mut bytes = Vec::new();
            encode(&Header::new(7, 29, 1), &written, &mut bytes).unwrap();
            prop_assert_eq!(bytes.len(), 24 + 16 * written.len());
            let Ok(Datagram::VirtualMarkers(header, items)) = Datagram::parse(&bytes) else { panic!("not read back") };
            prop_assert_eq!((header.sample_counter, header.avatar, items.len()), (7, 1, written.len()));
            prop_assert_eq!(items.collect::<Vec<_>>(), written);
        }
    }

    #[test]
    fn a_marker_up_high_is_up_high() {
        let marker = VirtualMarker { point_id: 0x0701, position_cm_y_up: [10.0, 170.0, 30.0] };
        assert_eq!(marker.to_z_up_m(), [0.3, 0.1, 1.7]);
    }
}
