//! Kistler's LabAmp: frames of a stream over TCP, and the HTTP requests that open it.
//!
//! Source: Kistler's own API documentation of the 5165A. It does not define the byte order; the only public reader uses
//! that of a PC. Every frame begins with a version that has always been 1, which reveals the order, so both orders are
//! supported.

pub mod talk;

use super::reader::Reader;
use super::sized::{Cut, Form, Sized};

/// Bytes of a frame's header.
pub const HEAD_SIZE: usize = 16;
/// Bytes of an event frame.
const EVENT_SIZE: usize = HEAD_SIZE + 4;
/// Bytes of a data frame before its values.
const DATA_SIZE: usize = HEAD_SIZE + 12;
/// Maximum size of a frame: eight channels, half a second at the highest rate.
const FRAME_MAX: usize = 4 << 20;
const VERSION: u16 = 1;

/// Byte order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Order {
    Little,
    Big,
}

impl Order {
    fn of([a, b, ..]: [u8; 8]) -> Option<Order> {
        match [a, b].map(u16::from) {
            [VERSION, 0] => Some(Order::Little),
            [0, VERSION] => Some(Order::Big),
            _ => None,
        }
    }

    fn u16(self, bytes: [u8; 2]) -> u16 {
        match self {
            Order::Little => u16::from_le_bytes(bytes),
            Order::Big => u16::from_be_bytes(bytes),
        }
    }

    fn u32(self, bytes: [u8; 4]) -> u32 {
        match self {
            Order::Little => u32::from_le_bytes(bytes),
            Order::Big => u32::from_be_bytes(bytes),
        }
    }

    fn u64(self, bytes: [u8; 8]) -> u64 {
        match self {
            Order::Little => u64::from_le_bytes(bytes),
            Order::Big => u64::from_be_bytes(bytes),
        }
    }
}

/// One frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame<'a> {
    /// Count of the frames of the stream, events included.
    pub sequence: u32,
    /// Number of the measurement; the 5165A has only number 1.
    pub measurement: u16,
    /// The contents.
    pub content: Content<'a>,
}

/// Contents of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Content<'a> {
    /// Samples.
    Data(Data<'a>),
    /// An event.
    Event(Event),
    /// An unsupported kind.
    Other,
}

/// Events of the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// The stream was closed by request.
    Closed,
    /// The buffer overflowed: data are missing.
    Overrun,
    /// The clock was set.
    TimeSkew,
    /// The device was reconfigured: the stream has ended.
    Reconfigured,
    /// The measurement was stopped.
    Stopped,
    /// An undefined code.
    Other(u16),
}

/// Consecutive scans, each with one value of every channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Data<'a> {
    /// Time of the first scan, ns since 1970 by the device's clock.
    pub time_ns: u64,
    order: Order,
    bytes: &'a [u8],
}

impl<'a> Data<'a> {
    /// Count of values.
    pub fn count(&self) -> usize {
        self.bytes.len() / 4
    }

    /// The values: all channels of the first scan, then those of the second.
    pub fn numbers(&self) -> impl ExactSizeIterator<Item = f32> + use<'a> {
        let order = self.order;
        // `chunks_exact(4)` yields four bytes.
        self.bytes.chunks_exact(4).map(move |four| {
            f32::from_bits(four.first_chunk().map_or(f32::NAN.to_bits(), |bytes| order.u32(*bytes)))
        })
    }
}

const FORM: Form = Form {
    size: |front @ [.., a, b, c, d]| match Order::of(front) {
        Some(order) => usize::try_from(order.u32([a, b, c, d])).unwrap_or(usize::MAX),
        None => usize::MAX,
    },
    least: HEAD_SIZE,
    most: FRAME_MAX,
    kept: FRAME_MAX,
};

/// Splits the stream into frames, independently of its division into pieces.
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

    /// The next complete frame; `None` until more bytes arrive.
    ///
    /// # Errors
    /// [`Malformed::Front`] means that later frames cannot be found; [`Malformed::Length`] concerns only this frame.
    pub fn next_frame(&mut self) -> Option<Result<Frame<'_>, Malformed>> {
        Some(match self.0.cut(FORM)? {
            Cut::Whole(frame) => parse(frame).ok_or(Malformed::Length { length: frame.len() }),
            Cut::PassedOver(front) | Cut::Nonsense(front) => Err(Malformed::Front { front }),
        })
    }
}

fn parse(bytes: &[u8]) -> Option<Frame<'_>> {
    let order = Order::of(*bytes.first_chunk()?)?;
    let mut reader = Reader::new(bytes);
    reader.array::<2>()?;
    let kind = order.u16(reader.array()?);
    reader.array::<4>()?;
    let sequence = order.u32(reader.array()?);
    let measurement = order.u16(reader.array()?);
    let subtype = order.u16(reader.array()?);
    let content = match (kind, subtype) {
        (0, 0) if bytes.len() >= EVENT_SIZE => {
            reader.array::<2>()?;
            Content::Event(match order.u16(reader.array()?) {
                0 => Event::Closed,
                1 => Event::Overrun,
                2 => Event::TimeSkew,
                3 => Event::Reconfigured,
                4 => Event::Stopped,
                code => Event::Other(code),
            })
        }
        (1, 1) if bytes.len() >= DATA_SIZE && bytes.len().is_multiple_of(4) => {
            let seconds = order.u64(reader.array()?);
            let nanoseconds = u64::from(order.u32(reader.array()?));
            let time_ns = seconds.checked_mul(1_000_000_000)?.checked_add(nanoseconds)?;
            Content::Data(Data { time_ns, order, bytes: reader.bytes(reader.remaining())? })
        }
        (0, 0) | (1, 1) => return None,
        _ => Content::Other,
    };
    Some(Frame { sequence, measurement, content })
}

/// Why bytes are not a LabAmp's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// No frame of version 1 begins with these bytes.
    #[error("{front:02x?} is no beginning of a frame of version 1 of Kistler's stream")]
    Front {
        /// Its first bytes.
        front: [u8; 8],
    },
    /// A frame whose length does not match its kind.
    #[error("a frame of {length} bytes has none of the two forms")]
    Length {
        /// Length in bytes.
        length: usize,
    },
}

// bytes    head                        bytes    event              bytes    data
// 0–1      version u16 = 1             16       level u8           16–23    seconds u64
// 2–3      kind u16: 0 event, 1 data   17       0                  24–27    nanoseconds u32
// 4–7      size u32, of all            18–19    code u16           28–      numbers f32, scan after scan
// 8–11     sequence u32
// 12–13    measurement u16
// 14–15    subtype u16: 0 event, 1 data with a time

#[cfg(test)]
mod tests;
