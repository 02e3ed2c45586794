//! Type 24: the suit's estimate of the whole body's centre of mass (MVN protocol, "Center of mass").
//!
//! 12 bytes in the specification; newer streams append velocity and acceleration: 36. The payload size distinguishes
//! them.

use super::Malformed;
use super::header::{DatagramType, Header, Oversized, frame};
use crate::wire::reader::{Reader, write_f32s};

/// The centre of mass in the suit's world (Z up).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CentreOfMass {
    /// Position, m.
    pub position_m: [f32; 3],
    /// Velocity and acceleration; only in payloads of 36 bytes.
    pub motion: Option<Motion>,
}

/// Motion of the centre of mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Velocity, m/s.
    pub velocity_m_per_s: [f32; 3],
    /// Acceleration, m/s².
    pub acceleration_m_per_s2: [f32; 3],
}

impl CentreOfMass {
    pub(super) fn parse(payload: &[u8]) -> Result<Self, Malformed> {
        let wrong = Malformed::Content { datagram_type: DatagramType::CENTRE_OF_MASS, field: "size" };
        if !matches!(payload.len(), 12 | 36) {
            return Err(wrong);
        }
        let mut reader = Reader::new(payload);
        let position_m = reader.f32s().ok_or(wrong)?;
        let motion = reader.f32s().zip(reader.f32s()).map(|(velocity_m_per_s, acceleration_m_per_s2)| {
            Motion { velocity_m_per_s, acceleration_m_per_s2 }
        });
        Ok(CentreOfMass { position_m, motion })
    }
}

/// Replaces the contents of `out` with one datagram of type 24.
///
/// # Errors
/// Never; the signature is that of the other types.
pub fn encode(header: &Header, com: &CentreOfMass, out: &mut Vec<u8>) -> Result<(), Oversized> {
    frame(header, DatagramType::CENTRE_OF_MASS, 1, out, |out| {
        write_f32s(&com.position_m, out);
        if let Some(motion) = com.motion {
            write_f32s(&motion.velocity_m_per_s, out);
            write_f32s(&motion.acceleration_m_per_s2, out);
        }
    })
}

// bytes    object
// 0–11     position_m 3 × f32
// 12–23    motion.velocity_m_per_s 3 × f32
// 24–35    motion.acceleration_m_per_s2 3 × f32

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;

    #[test]
    fn both_sizes_are_read_back() {
        let motion = Motion { velocity_m_per_s: [0.1, 0.2, 0.3], acceleration_m_per_s2: [1.0, 2.0, 3.0] };
        for motion in [None, Some(motion)] {
            let written = CentreOfMass { position_m: [0.01, 0.02, 0.97], motion };
            let mut bytes = Vec::new();
            encode(&Header::new(1, 4, 0), &written, &mut bytes).unwrap();
            assert_eq!(bytes.len(), if motion.is_some() { 60 } else { 36 });
            let Ok(Datagram::CentreOfMass(_, read)) = Datagram::parse(&bytes) else {
                panic!("not read back")
            };
            assert_eq!(read, written);
        }
    }
}
