//! The samples of a stream: a text header, two samples of a fixed test pattern, then the data.

use crate::wire::reader::Reader;

/// Maximum size of the header, which has some hundred bytes.
const HEAD_MAX: usize = 16_384;
const TAG_DEDUCED: u8 = 1;
const TAG_STAMPED: u8 = 2;
const PATTERN_TIME_S: f64 = 123_456.789;
/// Initial values of the two samples of the pattern.
const PATTERNS: [i64; 2] = [4, 2];

/// Number format of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// IEEE-754 binary32.
    Float32,
    /// IEEE-754 binary64.
    Double64,
    /// A signed integer of 8 bits.
    Int8,
    /// A signed integer of 16 bits.
    Int16,
    /// A signed integer of 32 bits.
    Int32,
    /// A signed integer of 64 bits.
    Int64,
}

impl Format {
    /// The format by its name in a stream's description; `None` for strings, which no plate sends.
    pub fn named(name: &str) -> Option<Format> {
        Some(match name {
            "float32" => Format::Float32,
            "double64" => Format::Double64,
            "int8" => Format::Int8,
            "int16" => Format::Int16,
            "int32" => Format::Int32,
            "int64" => Format::Int64,
            _ => return None,
        })
    }

    /// Size of a number, bytes.
    pub fn size(self) -> usize {
        match self {
            Format::Int8 => 1,
            Format::Int16 => 2,
            Format::Float32 | Format::Int32 => 4,
            Format::Double64 | Format::Int64 => 8,
        }
    }

    fn read(self, reader: &mut Reader<'_>, big_endian: bool) -> Option<f64> {
        Some(match self {
            Format::Float32 => f64::from(f32::from_bits(u32::from_le_bytes(ordered(reader, big_endian)?))),
            Format::Double64 => f64::from_bits(u64::from_le_bytes(ordered(reader, big_endian)?)),
            Format::Int8 => f64::from(i8::from_le_bytes(ordered(reader, big_endian)?)),
            Format::Int16 => f64::from(i16::from_le_bytes(ordered(reader, big_endian)?)),
            Format::Int32 => f64::from(i32::from_le_bytes(ordered(reader, big_endian)?)),
            // Beyond 2^53 the last bits are lost: no plate has such a resolution.
            Format::Int64 => i64::from_le_bytes(ordered(reader, big_endian)?) as f64,
        })
    }

    /// The pattern's value in a channel.
    fn pattern(self, first: i64, channel: usize) -> f64 {
        let channel = channel as i64;
        let magnitude = channel
            + first
            + match self {
                Format::Float32 => 0,
                Format::Double64 => 16_777_217,
                Format::Int8 => 1,
                Format::Int16 => 257,
                Format::Int32 => 65_537,
                Format::Int64 => 2_147_483_649,
            };
        let magnitude = match self {
            Format::Int8 => magnitude % i64::from(i8::MAX),
            Format::Int16 => magnitude % i64::from(i16::MAX),
            Format::Int32 => magnitude % i64::from(i32::MAX),
            Format::Float32 | Format::Double64 | Format::Int64 => magnitude,
        };
        (if channel % 2 == 0 { magnitude } else { -magnitude }) as f64
    }
}

/// Bytes in little-endian order.
fn ordered<const N: usize>(reader: &mut Reader<'_>, big_endian: bool) -> Option<[u8; N]> {
    let mut bytes = reader.array::<N>()?;
    if big_endian {
        bytes.reverse();
    }
    Some(bytes)
}

/// The next element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Item<'a> {
    /// Header and pattern are valid.
    Agreed,
    /// A sample.
    Sample {
        /// Sample time by the sender's clock, s; `None`: one period after the preceding sample.
        time_s: Option<f64>,
        /// One value for each channel.
        values: &'a [f64],
    },
}

/// Decoder of a feed.
#[derive(Debug, Clone)]
pub struct Feed {
    uid: String,
    format: Format,
    channels: usize,
    phase: Phase,
    buffer: Vec<u8>,
    taken: usize,
    values: Vec<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Head,
    Pattern { big_endian: bool, index: usize },
    Samples { big_endian: bool },
    Broken,
}

impl Feed {
    /// A feed before any data.
    pub fn new(uid: &str, format: Format, channels: usize) -> Feed {
        let values = vec![0.0; channels];
        Feed {
            uid: uid.to_owned(),
            format,
            channels,
            phase: Phase::Head,
            buffer: Vec::new(),
            taken: 0,
            values,
        }
    }

    /// Appends the next piece of the stream.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.taken);
        self.taken = 0;
        if self.phase != Phase::Broken {
            self.buffer.extend_from_slice(bytes);
        }
    }

    /// The next element; `None` until more bytes arrive.
    ///
    /// # Errors
    /// Why the feed cannot be decoded; no element follows.
    pub fn next_item(&mut self) -> Option<Result<Item<'_>, Malformed>> {
        let result = self.step();
        if result.is_err() {
            self.phase = Phase::Broken;
            self.buffer.clear();
            self.taken = 0;
        }
        match result.transpose()? {
            Ok(Step::Agreed) => Some(Ok(Item::Agreed)),
            Ok(Step::Sample(time_s)) => Some(Ok(Item::Sample { time_s, values: &self.values })),
            Err(error) => Some(Err(error)),
        }
    }

    fn step(&mut self) -> Result<Option<Step>, Malformed> {
        loop {
            match self.phase {
                Phase::Broken => return Ok(None),
                Phase::Head => {
                    let rest = self.buffer.get(self.taken..).unwrap_or_default();
                    let Some(end) = rest.windows(4).position(|four| four == b"\r\n\r\n") else {
                        return if rest.len() > HEAD_MAX { Err(Malformed::NotLsl) } else { Ok(None) };
                    };
                    let big_endian = head(&rest[..end], &self.uid)?;
                    self.taken += end + 4;
                    self.phase = Phase::Pattern { big_endian, index: 0 };
                }
                Phase::Pattern { big_endian, index } => {
                    let Some(time_s) = self.sample(big_endian)? else { return Ok(None) };
                    let first = PATTERNS.get(index).copied().unwrap_or_default();
                    let want = |channel| self.format.pattern(first, channel);
                    let as_announced =
                        self.values.iter().enumerate().all(|(channel, value)| *value == want(channel));
                    if !as_announced || time_s != Some(PATTERN_TIME_S) {
                        return Err(Malformed::Pattern);
                    }
                    if index + 1 < PATTERNS.len() {
                        self.phase = Phase::Pattern { big_endian, index: index + 1 };
                    } else {
                        self.phase = Phase::Samples { big_endian };
                        return Ok(Some(Step::Agreed));
                    }
                }
                Phase::Samples { big_endian } => return Ok(self.sample(big_endian)?.map(Step::Sample)),
            }
        }
    }

    /// Decodes one sample into `values`.
    fn sample(&mut self, big_endian: bool) -> Result<Option<Option<f64>>, Malformed> {
        let rest = self.buffer.get(self.taken..).unwrap_or_default();
        let stamp_size = match rest.first() {
            None => return Ok(None),
            Some(&TAG_DEDUCED) => 0,
            Some(&TAG_STAMPED) => 8,
            Some(tag) => return Err(Malformed::Tag { tag: *tag }),
        };
        let size = 1 + stamp_size + self.format.size() * self.channels;
        let Some(sample) = rest.get(1..size) else { return Ok(None) };
        let mut reader = Reader::new(sample);
        let time_s = match stamp_size {
            0 => None,
            _ => Format::Double64.read(&mut reader, big_endian),
        };
        for value in &mut self.values {
            // The size was checked, so all bytes are present.
            *value = self.format.read(&mut reader, big_endian).unwrap_or(f64::NAN);
        }
        self.taken += size;
        Ok(Some(time_s))
    }
}

enum Step {
    Agreed,
    Sample(Option<f64>),
}

/// Parses the header; returns whether numbers are big-endian.
fn head(bytes: &[u8], uid: &str) -> Result<bool, Malformed> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.split("\r\n");
    let status = lines.next().unwrap_or_default();
    let mut words = status.split(' ');
    let version = words.next().and_then(|word| word.strip_prefix("LSL/"));
    let code: Option<u32> = words.next().and_then(|word| word.parse().ok());
    match (version, code) {
        (Some(_), Some(200)) => {}
        (Some(_), Some(404)) => return Err(Malformed::Gone),
        (Some(_), Some(_)) => return Err(Malformed::Refused { status: status.to_owned() }),
        _ => return Err(Malformed::NotLsl),
    }
    let mut big_endian = false;
    for line in lines {
        let Some((key, value)) = line.split_once(':') else { continue };
        // A semicolon begins a comment.
        let value = value.split(';').next().unwrap_or_default().trim();
        match key.trim().to_ascii_lowercase().as_str() {
            "byte-order" => {
                big_endian = match value {
                    // Old senders use 0 for "no conversion"; all of them are little-endian.
                    "0" | "1234" => false,
                    "4321" => true,
                    _ => return Err(Malformed::ByteOrder),
                }
            }
            "uid" if !uid.is_empty() && !value.eq_ignore_ascii_case(uid) => return Err(Malformed::Gone),
            "data-protocol-version" if value != "110" => {
                return Err(Malformed::Version { version: value.to_owned() });
            }
            _ => {}
        }
    }
    Ok(big_endian)
}

/// Why a feed cannot be decoded.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// The peer is not an LSL outlet.
    #[error("what answers is no outlet of the lab streaming layer")]
    NotLsl,
    /// The outlet was replaced by another one.
    #[error("the stream is not there any more, and another one is in its place")]
    Gone,
    /// The outlet refuses the request.
    #[error("the outlet refuses: {status}")]
    Refused {
        /// The outlet's message.
        status: String,
    },
    /// An unsupported byte order.
    #[error("the outlet sends numbers in an unknown order of bytes")]
    ByteOrder,
    /// An unsupported protocol version.
    #[error("the outlet speaks version {version} of the protocol, not 110: update its liblsl")]
    Version {
        /// The version.
        version: String,
    },
    /// The samples of the test pattern have wrong values.
    #[error("the outlet's test pattern is not as it should be: the two ends do not mean the same")]
    Pattern,
    /// A sample begins with an invalid tag.
    #[error("a sample begins with {tag:#04x}, which none does")]
    Tag {
        /// The tag.
        tag: u8,
    },
}

// lines of the answer                       bytes   sample
// LSL/110 200 OK                            0       1: one period after the one before, 2: stamped
// UID: …                                    1–8     time f64, s, if stamped
// Byte-Order: 1234                          then    one number a channel
// Suppress-Subnormals: 0
// Data-Protocol-Version: 110
// (an empty line)
