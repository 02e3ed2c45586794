//! AMTI plates with a serial line: frames of 24 bytes, identified by the tags in their words.
//!
//! Little-endian. Source: the open receiver of the Lab Streaming Layer (App-AMTIForcePlate), which was used with real
//! plates. Two plates on one line send 48 bytes a frame in an unverified layout.

/// Strain gauges of a plate, one word each.
pub const CHANNELS: usize = 12;
/// Bytes of a frame.
pub const FRAME_SIZE: usize = 2 * CHANNELS;
/// The speed of the command phase, and of streaming at 50 frames a second, baud.
pub const SPEED_SLOW: u32 = 57_600;
/// The speed of streaming at higher rates, baud.
pub const SPEED_FAST: u32 = 115_200;
/// Answer to [`Command::Start`] of one plate.
pub const STARTED_ONE: u8 = 0x55;
/// Answer to [`Command::Start`] of two.
pub const STARTED_TWO: u8 = 0x56;
/// The middle of the converter's range, counts: zero force.
const ZERO_COUNTS: i16 = 2048;
/// The tag of word 0 while the plate's trigger input is active.
const TRIGGER_TAG: u16 = 0xF;

/// Commands to a plate, one byte each. The command that takes the present load as zero, 0x53, is not used: a worker who
/// stands on the plate at the start of an adapter would become the zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Command {
    /// Send frames. Answered by [`STARTED_ONE`] or [`STARTED_TWO`].
    Start = 0x51,
    /// Stop the stream. Not answered.
    Stop = 0x52,
    /// 50 frames a second at [`SPEED_SLOW`]. The plate answers a rate command by echoing it.
    Rate50 = 0x72,
    /// 100 frames a second at [`SPEED_FAST`].
    Rate100 = 0x66,
    /// 200 frames a second at [`SPEED_FAST`].
    Rate200 = 0x76,
}

/// One sample of a plate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Value of each gauge, counts about zero: -2048 to 2047.
    pub counts: [i16; CHANNELS],
    /// Whether the plate's trigger input is active.
    pub trigger: bool,
}

impl Frame {
    /// Parses a frame; `None` if a tag does not match its word.
    pub fn parse(bytes: &[u8; FRAME_SIZE]) -> Option<Frame> {
        let mut frame = Frame { counts: [0; CHANNELS], trigger: false };
        let (words, _) = bytes.as_chunks::<2>();
        for (index, (word, counts)) in words.iter().zip(&mut frame.counts).enumerate() {
            let word = u16::from_le_bytes(*word);
            let tag = word >> 12;
            frame.trigger |= index == 0 && tag == TRIGGER_TAG;
            if usize::from(tag) != index && !(index == 0 && frame.trigger) {
                return None;
            }
            *counts = (word & 0x0FFF).cast_signed() - ZERO_COUNTS;
        }
        Some(frame)
    }

    /// Encodes the frame as a plate does. Counts beyond the converter's range are clamped.
    pub fn to_bytes(self) -> [u8; FRAME_SIZE] {
        let mut bytes = [0; FRAME_SIZE];
        let (words, _) = bytes.as_chunks_mut::<2>();
        for ((word, counts), index) in words.iter_mut().zip(self.counts).zip(0u16..) {
            let tag = if index == 0 && self.trigger { TRIGGER_TAG } else { index };
            let level = counts.saturating_add(ZERO_COUNTS).clamp(0, 0x0FFF).cast_unsigned();
            *word = (tag << 12 | level).to_le_bytes();
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::sliding::{Sliding, StreamElement};
    use proptest::prelude::*;

    const VECTOR: [u8; FRAME_SIZE] = [
        0x00, 0x08, 0x0a, 0x18, 0x14, 0x28, 0x1e, 0x38, 0x28, 0x48, 0x32, 0x58, 0x3c, 0x68, 0x46, 0x78, 0x50,
        0x88, 0x5a, 0x98, 0x64, 0xa8, 0x6e, 0xb8,
    ];

    #[test]
    fn the_known_frame_is_read_and_written() {
        let counts = core::array::from_fn(|index| 10 * index as i16);
        let frame = Frame { counts, trigger: false };
        assert_eq!(Frame::parse(&VECTOR), Some(frame));
        assert_eq!(frame.to_bytes(), VECTOR);
        let mut pulled = VECTOR;
        pulled[1] = 0xf8;
        assert_eq!(Frame::parse(&pulled), Some(Frame { trigger: true, ..frame }));
        // Only word 0 may have the trigger tag.
        let mut wrong = VECTOR;
        wrong[3] = 0xf8;
        assert_eq!(Frame::parse(&wrong), None);
    }

    #[test]
    fn frames_are_found_from_any_start_and_cut_of_the_stream() {
        for from in 0..FRAME_SIZE {
            let mut stream = Sliding::default();
            let mut elements = Vec::new();
            for byte in [VECTOR, VECTOR, VECTOR].concat().into_iter().skip(from) {
                stream.push(&[byte]);
                while let Some(StreamElement::Frame(_)) =
                    stream.next(Frame::parse).inspect(|it| elements.push(*it))
                {}
            }
            let frames = elements.iter().filter(|it| matches!(it, StreamElement::Frame(_))).count();
            assert_eq!(frames, if from == 0 { 3 } else { 2 }, "entered at {from}");
            let skipped: usize = elements
                .iter()
                .map(|it| if let StreamElement::Skipped { bytes, .. } = it { *bytes } else { 0 })
                .sum();
            assert_eq!(skipped, (FRAME_SIZE - from) % FRAME_SIZE);
        }
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(counts in proptest::array::uniform12(-2048i16..2048), trigger: bool) {
            let frame = Frame { counts, trigger };
            prop_assert_eq!(Frame::parse(&frame.to_bytes()), Some(frame));
        }
    }
}
