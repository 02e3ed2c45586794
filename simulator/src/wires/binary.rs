//! Frames with sync bytes, sequence and check sum, as home-made plates send them: `A5 5A`, a number, a time, six
//! floats, and CRC-16/CCITT-FALSE over all before it. Little-endian.

use super::crc;

/// First bytes of a frame.
pub const SYNC: [u8; 2] = [0xa5, 0x5a];
/// Length of a frame.
pub const FRAME_LEN: usize = 34;

/// One sample.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Frame {
    /// Counts frames, modulo 2¹⁶.
    pub sequence: u16,
    /// The device's clock, µs.
    pub time_us: u32,
    /// Fx Fy Fz (N), Mx My Mz (N m).
    pub wrench: [f32; 6],
}

impl Frame {
    /// The bytes.
    pub fn to_bytes(&self) -> [u8; FRAME_LEN] {
        let mut bytes = SYNC.to_vec();
        bytes.extend_from_slice(&self.sequence.to_le_bytes());
        bytes.extend_from_slice(&self.time_us.to_le_bytes());
        bytes.extend(self.wrench.iter().flat_map(|number| number.to_le_bytes()));
        bytes.extend_from_slice(&crc::ccitt_false(&bytes).to_le_bytes());
        core::array::from_fn(|index| bytes[index])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_has_its_fields_in_their_places() {
        let bytes = Frame { sequence: 0x0102, time_us: 5, wrench: [1.0; 6] }.to_bytes();
        assert_eq!(bytes[..8], [0xa5, 0x5a, 0x02, 0x01, 5, 0, 0, 0]);
        assert_eq!(bytes[8..12], 1.0_f32.to_le_bytes());
        assert_eq!(bytes[32..], crc::ccitt_false(&bytes[..32]).to_le_bytes());
    }
}
