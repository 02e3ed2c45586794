//! Type 22: segment orientations, angular velocities and accelerations (MVN protocol, "Angular segment kinematics").
//!
//! Radians, although some parsers assume degrees: recordings of the same channels agree with finite differences in
//! rad/s.

use super::header::{DatagramType, Header, Oversized};
use super::items::{self, Item};
use crate::wire::reader::{Reader, write_f32s};

/// One segment's angular motion in the suit's world (Z up).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngularKinematics {
    /// MVN segment id, from 1: index plus one for the 23 of the body.
    pub segment_id: u32,
    /// `suitworld_from_segment`, scalar first.
    pub orientation_wxyz: [f32; 4],
    /// Angular velocity, rad/s.
    pub angular_velocity_rad_per_s: [f32; 3],
    /// Angular acceleration, rad/s².
    pub angular_acceleration_rad_per_s2: [f32; 3],
}

impl Item for AngularKinematics {
    const DATAGRAM_TYPE: DatagramType = DatagramType::ANGULAR_KINEMATICS;
    const SIZE: usize = 44;

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(AngularKinematics {
            segment_id: reader.u32()?,
            orientation_wxyz: reader.f32s()?,
            angular_velocity_rad_per_s: reader.f32s()?,
            angular_acceleration_rad_per_s2: reader.f32s()?,
        })
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.segment_id.to_be_bytes());
        write_f32s(&self.orientation_wxyz, out);
        write_f32s(&self.angular_velocity_rad_per_s, out);
        write_f32s(&self.angular_acceleration_rad_per_s2, out);
    }
}

/// Replaces the contents of `out` with one datagram of type 22; order as in type 02.
///
/// # Errors
/// [`Oversized`] for more than 255 items.
pub fn encode(header: &Header, items: &[AngularKinematics], out: &mut Vec<u8>) -> Result<(), Oversized> {
    items::encode(header, items, out)
}

// bytes    object (each item)
// 0–3      segment_id u32
// 4–19     orientation_wxyz 4 × f32
// 20–31    angular_velocity_rad_per_s 3 × f32
// 32–43    angular_acceleration_rad_per_s2 3 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(values in proptest::collection::vec((any::<u32>(), proptest::array::uniform10(-1e3f32..1e3)), 1..64)) {
            let written: Vec<_> = values.into_iter().map(|(id, v)| AngularKinematics { segment_id: id, orientation_wxyz: [v[0], v[1], v[2], v[3]], angular_velocity_rad_per_s: [v[4], v[5], v[6]], angular_acceleration_rad_per_s2: [v[7], v[8], v[9]] }).collect();
            let mut bytes = Vec::new();
            encode(&Header::new(7, 29, 1), &written, &mut bytes).unwrap();
            prop_assert_eq!(bytes.len(), 24 + 44 * written.len());
            let Ok(Datagram::AngularKinematics(header, items)) = Datagram::parse(&bytes) else { panic!("not read back") };
            prop_assert_eq!((header.sample_counter, header.avatar, items.len()), (7, 1, written.len()));
            prop_assert_eq!(items.collect::<Vec<_>>(), written);
        }
    }
}
