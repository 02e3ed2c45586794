//! Type 21: segment positions, velocities and accelerations (MVN protocol, "Linear segment kinematics").

use super::header::{DatagramType, Header, Oversized};
use super::items::{self, Item};
use super::pose_quaternion::y_up_to_z_up;
use crate::wire::reader::{Reader, write_f32s};

/// One segment's linear motion in the suit's world (Z up).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearKinematics {
    /// MVN segment id, from 1: index plus one for the 23 of the body.
    pub segment_id: u32,
    /// Segment origin, m.
    pub position_m: [f32; 3],
    /// Velocity of the origin, m/s.
    pub velocity_m_per_s: [f32; 3],
    /// Acceleration of the origin, without gravity, m/s².
    pub acceleration_m_per_s2: [f32; 3],
}

impl LinearKinematics {
    /// Converts the motion from a world whose Y points up (X left, Y up, Z forward).
    #[must_use]
    pub fn y_up_to_z_up(&self) -> LinearKinematics {
        LinearKinematics {
            segment_id: self.segment_id,
            position_m: y_up_to_z_up(self.position_m),
            velocity_m_per_s: y_up_to_z_up(self.velocity_m_per_s),
            acceleration_m_per_s2: y_up_to_z_up(self.acceleration_m_per_s2),
        }
    }
}

impl Item for LinearKinematics {
    const DATAGRAM_TYPE: DatagramType = DatagramType::LINEAR_KINEMATICS;
    const SIZE: usize = 40;

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        Some(LinearKinematics {
            segment_id: reader.u32()?,
            position_m: reader.f32s()?,
            velocity_m_per_s: reader.f32s()?,
            acceleration_m_per_s2: reader.f32s()?,
        })
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.segment_id.to_be_bytes());
        write_f32s(&self.position_m, out);
        write_f32s(&self.velocity_m_per_s, out);
        write_f32s(&self.acceleration_m_per_s2, out);
    }
}

/// Replaces the contents of `out` with one datagram of type 21; order as in type 02.
///
/// # Errors
/// [`Oversized`] for more than 255 items.
pub fn encode(header: &Header, items: &[LinearKinematics], out: &mut Vec<u8>) -> Result<(), Oversized> {
    items::encode(header, items, out)
}

// bytes    object (each item)
// 0–3      segment_id u32
// 4–15     position_m 3 × f32
// 16–27    velocity_m_per_s 3 × f32
// 28–39    acceleration_m_per_s2 3 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(values in proptest::collection::vec((any::<u32>(), proptest::array::uniform9(-1e3f32..1e3)), 1..64)) {
            let written: Vec<_> = values.into_iter().map(|(id, v)| LinearKinematics { segment_id: id, position_m: [v[0], v[1], v[2]], velocity_m_per_s: [v[3], v[4], v[5]], acceleration_m_per_s2: [v[6], v[7], v[8]] }).collect();
            let mut bytes = Vec::new();
            encode(&Header::new(7, 29, 1), &written, &mut bytes).unwrap();
            prop_assert_eq!(bytes.len(), 24 + 40 * written.len());
            let Ok(Datagram::LinearKinematics(header, items)) = Datagram::parse(&bytes) else { panic!("not read back") };
            prop_assert_eq!((header.sample_counter, header.avatar, items.len()), (7, 1, written.len()));
            prop_assert_eq!(items.collect::<Vec<_>>(), written);
        }
    }
}
