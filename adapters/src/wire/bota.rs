//! Bota (and Rokubi) sensors over a serial line: frames of 37 bytes with a checksum, and the text commands of the
//! set-up.
//!
//! Little-endian. Source: the maker's own receivers (`BOTAsys/matlab`, `bota_serial_example.py`).

use super::reader::Reader;
use crc::{CRC_16_IBM_SDLC, Crc};

/// Bytes of a frame.
pub const FRAME_SIZE: usize = 37;
/// The default speed of sensors, baud.
pub const SPEED: u32 = 460_800;
/// The speeds of a sensor, baud, in the order of their numbers in [`setup`].
pub const SPEEDS: [u32; 5] = [9600, 57_600, 115_200, 230_400, SPEED];
/// Frame rate times the length of the filter.
pub const RATE_TIMES_SINC_HZ: u32 = 51_200;
/// The first byte of a frame; other bytes may have the same value.
pub const HEADER: u8 = 0xAA;
/// Also called X-25: polynomial 0x1021 reflected, initial value all ones, result inverted.
const CHECKSUM: Crc<u16> = Crc::<u16>::new(&CRC_16_IBM_SDLC);

/// Bits of the status word.
pub mod status {
    /// The sensor was late with a sample; the values are valid.
    pub const LATE: u16 = 1;
    /// A gauge is beyond its range.
    pub const OVERRANGE: u16 = 1 << 1;
    /// The values are invalid.
    pub const INVALID: u16 = 1 << 2;
    /// The values are counts of the gauges, not forces.
    pub const RAW: u16 = 1 << 3;
}

/// One sample of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Bits of [`status`].
    pub status: u16,
    /// Force x, y, z on the sensor, N.
    pub force_n: [f32; 3],
    /// Torque x, y, z about the sensor's origin, N m.
    pub torque_nm: [f32; 3],
    /// The sensor's clock, which wraps; presumably in microseconds.
    pub timestamp_us: u32,
    /// °C.
    pub temperature_c: f32,
}

impl Frame {
    /// Parses a frame; `None` if its header or its checksum does not match.
    pub fn parse(bytes: &[u8; FRAME_SIZE]) -> Option<Frame> {
        let (head, body, sum) = parts(bytes)?;
        (head == HEADER && CHECKSUM.checksum(body) == sum).then(|| Frame::read(body)).flatten()
    }

    fn read(body: &[u8]) -> Option<Frame> {
        let mut reader = Reader::new(body);
        let three = |reader: &mut Reader<'_>| -> Option<[f32; 3]> {
            let mut next = || reader.array().map(f32::from_le_bytes);
            Some([next()?, next()?, next()?])
        };
        Some(Frame {
            status: reader.array().map(u16::from_le_bytes)?,
            force_n: three(&mut reader)?,
            torque_nm: three(&mut reader)?,
            timestamp_us: reader.array().map(u32::from_le_bytes)?,
            temperature_c: reader.array().map(f32::from_le_bytes)?,
        })
    }

    /// Encodes the frame, as a sensor does.
    pub fn to_bytes(self) -> [u8; FRAME_SIZE] {
        let mut body = self.status.to_le_bytes().to_vec();
        for number in self.force_n.into_iter().chain(self.torque_nm) {
            body.extend_from_slice(&number.to_le_bytes());
        }
        body.extend_from_slice(&self.timestamp_us.to_le_bytes());
        body.extend_from_slice(&self.temperature_c.to_le_bytes());
        let sum = CHECKSUM.checksum(&body).to_le_bytes();
        let mut bytes = [HEADER; FRAME_SIZE];
        for (place, byte) in bytes.iter_mut().skip(1).zip(body.into_iter().chain(sum)) {
            *place = byte;
        }
        bytes
    }
}

/// Header, body, checksum.
fn parts(bytes: &[u8; FRAME_SIZE]) -> Option<(u8, &[u8], u16)> {
    let (head, rest) = bytes.split_first()?;
    let (body, sum) = rest.split_last_chunk::<2>()?;
    Some((*head, body, u16::from_le_bytes(*sum)))
}

/// Set-up of a sensor: commands in order, with the answer to each.
///
/// Calibrated forces, no temperature compensation (the maker's advice), binary frames at `speed`, a filter of length
/// `sinc` without chopping, at normal speed and without the second filter. `None` for a speed that sensors do not
/// support.
pub fn setup(sinc: u32, speed: u32) -> Option<[(String, &'static str); 4]> {
    let number = SPEEDS.iter().position(|known| *known == speed)?;
    Some([
        ("C".to_owned(), "r,0,C,0"),
        (format!("c,0,1,0,{number}"), "r,0,c,0"),
        (format!("f,{sinc},0,0,1"), "r,0,f,0"),
        ("R".to_owned(), "r,0,R,0"),
    ])
}

// bytes    object
// 0        0xAA
// 1–2      status u16
// 3–14     force_n 3 × f32
// 15–26    torque_nm 3 × f32
// 27–30    timestamp_us u32
// 31–34    temperature_c f32
// 35–36    checksum u16 of bytes 1–34

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::sliding::{Sliding, StreamElement};
    use proptest::prelude::*;

    const VECTOR: [u8; FRAME_SIZE] = [
        0xaa, 0x00, 0x00, 0x00, 0x00, 0xc0, 0x3f, 0x00, 0x00, 0x20, 0xc0, 0x00, 0x10, 0x2f, 0x44, 0xcd, 0xcc,
        0x4c, 0xbc, 0x96, 0x43, 0x0b, 0x3d, 0x00, 0x00, 0x00, 0x3f, 0x15, 0xcd, 0x5b, 0x07, 0x00, 0x00, 0xfa,
        0x41, 0x01, 0x81,
    ];

    #[test]
    fn the_known_frame_is_read_and_written() {
        assert_eq!(CHECKSUM.checksum(b"123456789"), 0x906e);
        let frame = Frame {
            status: 0,
            force_n: [1.5, -2.5, 700.25],
            torque_nm: [-0.0125, 0.034, 0.5],
            timestamp_us: 123_456_789,
            temperature_c: 31.25,
        };
        assert_eq!(Frame::parse(&VECTOR), Some(frame));
        assert_eq!(frame.to_bytes(), VECTOR);
        for bit in 0..FRAME_SIZE * 8 {
            let mut damaged = VECTOR;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Frame::parse(&damaged), None, "bit {bit}");
        }
    }

    #[test]
    fn a_false_beginning_costs_one_byte_and_no_frame() {
        let mut stream = Sliding::default();
        stream.push(&[[HEADER, HEADER].as_slice(), &VECTOR, &[HEADER], &VECTOR].concat());
        let mut next = || {
            stream.next(Frame::parse).map(|element| match element {
                StreamElement::Frame(_) => 0,
                StreamElement::Skipped { bytes, .. } => bytes,
            })
        };
        assert_eq!([next(), next(), next(), next(), next()], [Some(2), Some(0), Some(1), Some(0), None]);
    }

    #[test]
    fn a_sensor_is_set_up_as_its_makers_do() {
        let said: Vec<String> = setup(512, SPEED).unwrap().into_iter().map(|(said, _)| said).collect();
        assert_eq!(said, ["C", "c,0,1,0,4", "f,512,0,0,1", "R"]);
        assert_eq!(setup(512, 1200), None);
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(
            status: u16, force_n in proptest::array::uniform3(-1e6f32..1e6), torque_nm in proptest::array::uniform3(-1e4f32..1e4),
            timestamp_us: u32, temperature_c in -40f32..120.0,
        ) {
            let frame = Frame { status, force_n, torque_nm, timestamp_us, temperature_c };
            prop_assert_eq!(Frame::parse(&frame.to_bytes()), Some(frame));
        }

        #[test]
        fn frames_between_noise_are_all_found(noise in proptest::collection::vec(any::<u8>(), 0..80), cut in 1usize..40) {
            let bytes = [noise.as_slice(), &VECTOR, &VECTOR, &VECTOR].concat();
            // One of 65536 damaged frames has a matching checksum, which cannot be detected.
            let by_chance = |window: &[u8]| window.try_into().is_ok_and(|bytes| Frame::parse(bytes).is_some());
            prop_assume!(!bytes.windows(FRAME_SIZE).take(noise.len()).any(by_chance));
            let mut stream = Sliding::default();
            let mut frames = 0;
            for piece in bytes.chunks(cut) {
                stream.push(piece);
                while let Some(element) = stream.next(Frame::parse) {
                    frames += usize::from(matches!(element, StreamElement::Frame(_)));
                }
            }
            prop_assert_eq!(frames, 3);
        }
    }
}
