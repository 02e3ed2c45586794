//! Qualisys' real-time protocol over TCP: packets with a length prefix, text commands in one direction and frames in
//! the other.
//!
//! Little-endian, as on port 22223 (22222 has the older, big-endian form). Sources: the packet layout of Qualisys' own
//! Python library, version 1.25 of the protocol; the QTM manual for the meaning of forces.

use super::reader::Reader;
use super::sized::{Cut, Form, Sized};

/// The port of the little-endian protocol.
pub const DEFAULT_PORT: u16 = 22_223;
/// The requested version of the protocol; QTM keeps old versions working.
pub const VERSION: &str = "1.25";
/// Bytes of a packet's header: size and kind.
pub const HEAD_SIZE: usize = 8;
/// Larger packets are files and images, which are not requested; a stream that announces them is not QTM's.
pub const PACKET_MAX: usize = 16 << 20;
/// Larger packets are skipped: forces of the largest laboratory need far fewer bytes.
const KEPT_MAX: usize = 1 << 20;
/// `u32 size` and `u32 kind` of a component.
const COMPONENT_HEAD_SIZE: usize = 8;
const COMPONENT_FORCE: u32 = 4;
const COMPONENT_FORCE_SINGLE: u32 = 15;
/// Numbers of one force: force, moment, application point.
const NUMBERS: usize = 9;
const FORCE_SIZE: usize = 4 * NUMBERS;

/// Encodes a text packet: a command to QTM or, in tests, a text from QTM.
pub fn command(text: &str) -> Vec<u8> {
    packet(1, &[text.as_bytes(), &[0]].concat())
}

fn packet(kind: u32, content: &[u8]) -> Vec<u8> {
    let size = u32::try_from(HEAD_SIZE + content.len()).unwrap_or(u32::MAX);
    [&size.to_le_bytes(), &kind.to_le_bytes(), content].concat()
}

/// A packet from QTM.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Packet<'a> {
    /// An error message.
    Error(&'a str),
    /// A reply text.
    Text(&'a str),
    /// A frame.
    Frame(Frame<'a>),
    /// No measurement is running, so no data follow.
    NoMoreData,
    /// An event.
    Event(Event),
    /// An unsupported kind.
    Other(u32),
}

/// Events of QTM that are relevant to a receiver of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// Frames follow: a preview, a capture or the replay of a file began.
    Started,
    /// No more frames follow.
    Stopped,
    /// QTM is shutting down.
    ShuttingDown,
    /// Any other event.
    Other(u8),
}

impl Event {
    fn of(number: u8) -> Event {
        match number {
            // Connected (a preview), capture started, replay started.
            1 | 3 | 8 => Event::Started,
            // Connection closed, capture stopped, replay stopped.
            2 | 4 | 9 => Event::Stopped,
            12 => Event::ShuttingDown,
            other => Event::Other(other),
        }
    }
}

/// One camera frame, with all data measured for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame<'a> {
    /// Time since the start of the measurement, µs.
    pub timestamp_us: u64,
    /// Count of the frames. Some versions always report 1 while no capture is running.
    pub number: u32,
    components: u32,
    bytes: &'a [u8],
}

/// Measurements of one plate during a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateForces<'a> {
    /// Number of the plate, from 1.
    pub plate: u32,
    /// Number of the first force in this frame, counted for each plate. `None` for single forces.
    pub first: Option<u32>,
    bytes: &'a [u8],
}

/// One force on a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateForce {
    /// N.
    pub force_n: [f32; 3],
    /// N m.
    pub moment_nm: [f32; 3],
    /// Point of application, mm.
    pub point_mm: [f32; 3],
}

impl<'a> Frame<'a> {
    fn parse(bytes: &'a [u8]) -> Option<Frame<'a>> {
        let mut reader = Reader::new(bytes);
        // A time before the start of the measurement is invalid.
        let timestamp_us = u64::try_from(i64::from_le_bytes(reader.array()?)).ok()?;
        let number = u32_le(&mut reader)?;
        let components = u32_le(&mut reader)?;
        Some(Frame { timestamp_us, number, components, bytes: reader.bytes(reader.remaining())? })
    }

    /// The forces of one plate; `Ok(None)` if the frame contains none.
    ///
    /// # Errors
    /// The frame's lengths are inconsistent.
    pub fn plate(&self, plate: u32) -> Result<Option<PlateForces<'a>>, Malformed> {
        let mut found = None;
        self.each_plate(|forces| {
            if forces.plate == plate && found.is_none() {
                found = Some(forces);
            }
        })
        .ok_or(Malformed::Frame { number: self.number })?;
        Ok(found)
    }

    /// The numbers of all plates in the frame.
    pub fn plates(&self) -> Vec<u32> {
        let mut plates = Vec::new();
        let _until_it_makes_no_sense = self.each_plate(|forces| plates.push(forces.plate));
        plates
    }

    fn each_plate(&self, mut each: impl FnMut(PlateForces<'a>)) -> Option<()> {
        let mut rest = Reader::new(self.bytes);
        for _ in 0..self.components {
            let size = usize::try_from(u32_le(&mut rest)?).ok()?;
            let kind = u32_le(&mut rest)?;
            let mut component = Reader::new(rest.bytes(size.checked_sub(COMPONENT_HEAD_SIZE)?)?);
            if kind != COMPONENT_FORCE && kind != COMPONENT_FORCE_SINGLE {
                continue;
            }
            for _ in 0..u32_le(&mut component)? {
                let plate = u32_le(&mut component)?;
                let (count, first) = match kind {
                    COMPONENT_FORCE => (u32_le(&mut component)?, Some(u32_le(&mut component)?)),
                    _ => (1, None),
                };
                let length = usize::try_from(count).ok()?.checked_mul(FORCE_SIZE)?;
                each(PlateForces { plate, first, bytes: component.bytes(length)? });
            }
            // Remaining bytes indicate a different layout.
            component.is_empty().then_some(())?;
        }
        rest.is_empty().then_some(())
    }
}

impl PlateForces<'_> {
    /// Count of forces.
    pub fn count(&self) -> usize {
        self.bytes.len() / FORCE_SIZE
    }

    /// The forces, oldest first.
    pub fn forces(&self) -> impl ExactSizeIterator<Item = PlateForce> {
        self.bytes.chunks_exact(FORCE_SIZE).map(|bytes| {
            let mut reader = Reader::new(bytes);
            // The chunk contains nine numbers.
            let mut three =
                || core::array::from_fn(|_| reader.array().map(f32::from_le_bytes).unwrap_or(f32::NAN));
            PlateForce { force_n: three(), moment_nm: three(), point_mm: three() }
        })
    }
}

fn u32_le(reader: &mut Reader<'_>) -> Option<u32> {
    reader.array().map(u32::from_le_bytes)
}

const FORM: Form = Form {
    size: |[a, b, c, d, ..]| usize::try_from(u32::from_le_bytes([a, b, c, d])).unwrap_or(usize::MAX),
    least: HEAD_SIZE,
    most: PACKET_MAX,
    kept: KEPT_MAX,
};

/// Splits QTM's stream into packets, independently of its division into pieces.
#[derive(Debug, Clone, Default)]
pub struct Deframer(Sized);

impl Deframer {
    /// Discards partially received data.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Appends the next piece of the stream.
    pub fn push(&mut self, bytes: &[u8]) {
        self.0.push(bytes);
    }

    /// The next complete packet; `None` until more bytes arrive.
    ///
    /// # Errors
    /// An invalid packet; after [`Malformed::Size`] later packets cannot be found.
    pub fn next_packet(&mut self) -> Option<Result<Packet<'_>, Malformed>> {
        let kind = |front: &[u8]| front.last_chunk().map_or(u32::MAX, |kind| u32::from_le_bytes(*kind));
        Some(match self.0.cut(FORM)? {
            Cut::Whole(packet) => {
                let (front, content) = packet.split_at_checked(HEAD_SIZE)?;
                parse(kind(front), content)
            }
            Cut::PassedOver(front) => Ok(Packet::Other(kind(&front))),
            Cut::Nonsense([a, b, c, d, ..]) => {
                Err(Malformed::Size { announced: u32::from_le_bytes([a, b, c, d]) })
            }
        })
    }
}

fn parse(kind: u32, content: &[u8]) -> Result<Packet<'_>, Malformed> {
    let text = || {
        let ended = content.split(|byte| *byte == 0).next().unwrap_or_default();
        core::str::from_utf8(ended).map_err(|_| Malformed::NotText)
    };
    Ok(match kind {
        0 => Packet::Error(text()?),
        1 => Packet::Text(text()?),
        3 => Packet::Frame(Frame::parse(content).ok_or(Malformed::Frame { number: 0 })?),
        4 => Packet::NoMoreData,
        6 => Packet::Event(Event::of(*content.first().ok_or(Malformed::EmptyEvent)?)),
        other => Packet::Other(other),
    })
}

/// Why bytes are not QTM's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// The length is invalid.
    #[error("a packet of {announced} bytes is none of Qualisys' track manager{}", hint(*announced))]
    Size {
        /// The length in the packet.
        announced: u32,
    },
    /// Lengths within a frame are inconsistent.
    #[error("the lengths in frame {number} contradict each other")]
    Frame {
        /// The frame's number, 0 if it could not be read.
        number: u32,
    },
    /// A text is not UTF-8.
    #[error("a text is no UTF-8")]
    NotText,
    /// An event without a number.
    #[error("an event without a number")]
    EmptyEvent,
}

fn hint(announced: u32) -> &'static str {
    match announced.swap_bytes() as usize {
        HEAD_SIZE..=PACKET_MAX => {
            ", but the other byte order makes sense: the little-endian port is the one needed, 22223 by default"
        }
        _ => "; is it another program's port?",
    }
}

// bytes   packet                bytes   frame               bytes  force component      single component
// 0–3     size u32              0–7     timestamp_us i64    0–3    size u32             0–3    size u32
// 4–7     kind u32              8–11    number u32          4–7    kind u32 = 4         4–7    kind u32 = 15
// 8–      content               12–15   components u32      8–11   plates u32           8–11   plates u32
//                               16–     components          then, for each plate        then, for each plate
// kinds: 0 error, 1 text,                                   0–3    plate u32            0–3    plate u32
// 3 frame, 4 no more data,                                  4–7    count u32            4–39   force
// 6 event u8                                                8–11   first u32
//                                                           12–    count × force
// force: force_n 3 × f32, moment_nm 3 × f32, point_mm 3 × f32

#[cfg(test)]
mod tests;
