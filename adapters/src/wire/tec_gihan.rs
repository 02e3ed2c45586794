//! Tec Gihan's force plate controller over a serial line: short ASCII lines, and blocks of counts without header or
//! checksum.
//!
//! 1 Mbaud, 8N1, RTS/CTS. Lines end with a line feed. The first block follows `START`; each further one must be
//! requested with `DT`. Source: the maker's own Python library (tecgihan/forceplate-python); no other documentation is
//! public.

use super::reader::Reader;

/// Speed of the line, baud.
pub const BAUD: u32 = 1_000_000;
/// Numbers of a sample: force x, y, z, moment x, y, z.
pub const CHANNELS: usize = 6;
/// Bytes of a sample.
pub const SAMPLE_SIZE: usize = 2 * CHANNELS;
/// Counts at full scale.
const FULL_SCALE_COUNTS: f64 = 30_000.0;
/// Maximum count of plates on a controller.
pub const PLATES_MAX: u32 = 20;

/// Sampling rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rate {
    /// Hz.
    pub hz: u32,
    name: &'static str,
    /// Samples in a block.
    pub block_samples: u32,
}

impl Rate {
    /// All rates of the controller, fastest first.
    pub const ALL: [Rate; 8] = [
        Rate { hz: 10_000, name: "10K", block_samples: 100 },
        Rate { hz: 5000, name: "5K", block_samples: 100 },
        Rate { hz: 2500, name: "2.5K", block_samples: 100 },
        Rate { hz: 1000, name: "1K", block_samples: 100 },
        Rate { hz: 500, name: "500", block_samples: 100 },
        Rate { hz: 250, name: "250", block_samples: 100 },
        Rate { hz: 240, name: "240", block_samples: 24 },
        Rate { hz: 120, name: "120", block_samples: 12 },
    ];

    /// The rate of this frequency, if it exists.
    pub fn of_hz(hz: u32) -> Option<Rate> {
        Rate::ALL.into_iter().find(|rate| rate.hz == hz)
    }

    /// Duration of a block, ns.
    pub fn block_ns(self) -> u64 {
        u64::from(self.block_samples) * 1_000_000_000 / u64::from(self.hz)
    }
}

/// Vertical full scale of the amplifiers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Range {
    /// 3 kN.
    Kn3 = 0,
    /// 6 kN.
    Kn6 = 1,
    /// 10 kN.
    Kn10 = 2,
}

/// Commands and queries to the controller; [`Line::to_bytes`] appends the line end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Line {
    /// Stop the measurement. No answer.
    Stop,
    /// Start the measurement; the first block follows unrequested.
    Start,
    /// Request the next block.
    NextBlock,
    /// Wake from sleep. No answer.
    Wake,
    /// Query the state.
    State,
    /// Set the sampling rate.
    SetRate(Rate),
    /// Set the full scale. No answer.
    SetRange(Range),
    /// Query the count of plates.
    PlateCount,
    /// Query the serial number of a plate, counted from 0.
    PlateSerial(u32),
    /// Query the height of a plate's surface over its sensors, by serial number.
    SurfaceHeight(u32),
    /// Query the full scales of a plate, by serial number.
    FullScales(u32),
}

impl Line {
    /// Encodes the line.
    pub fn to_bytes(self) -> Vec<u8> {
        let text = match self {
            Line::Stop => "STOP".to_owned(),
            Line::Start => "START".to_owned(),
            Line::NextBlock => "DT".to_owned(),
            Line::Wake => "WAKE".to_owned(),
            Line::State => "STATE".to_owned(),
            Line::SetRate(rate) => format!("SPS_{}", rate.name),
            Line::SetRange(Range::Kn3) => "RANGE_3kN".to_owned(),
            Line::SetRange(Range::Kn6) => "RANGE_6kN".to_owned(),
            Line::SetRange(Range::Kn10) => "RANGE_10kN".to_owned(),
            Line::PlateCount => "FPCOUNT".to_owned(),
            Line::PlateSerial(plate) => format!("FPSERIAL_{plate}"),
            Line::SurfaceHeight(serial) => format!("FP_{serial:04}_GET_AZ0"),
            Line::FullScales(serial) => format!("FP_{serial:04}_GETFS"),
        };
        (text + "\n").into_bytes()
    }

    /// Parses an answer to this line; `None` if it is not one.
    pub fn answer(self, line: &str) -> Option<Answer> {
        let line = line.trim();
        let value = |prefix: &str| line.strip_prefix(prefix).map(str::trim);
        match self {
            Line::State => State::of(line).map(Answer::State),
            Line::SetRate(_) => line.contains("SPS_OK").then_some(Answer::Done),
            Line::PlateCount => value("FPCOUNT_")?.parse().ok().map(Answer::Number),
            Line::PlateSerial(plate) => {
                value(&format!("FPSERIAL_{plate}_"))?.parse().ok().map(Answer::Number)
            }
            Line::SurfaceHeight(_) => {
                let metres: f64 = value("AZ0_")?.parse().ok()?;
                metres.is_finite().then_some(Answer::Metres(metres))
            }
            Line::FullScales(_) => FullScales::parse(value("FS_")?).map(Answer::FullScales),
            Line::Stop | Line::Start | Line::NextBlock | Line::Wake | Line::SetRange(_) => None,
        }
    }
}

/// An answer of the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer {
    /// The command was executed.
    Done,
    /// The state.
    State(State),
    /// A count or a serial number.
    Number(u32),
    /// A length, m; the maker's sign is negative, downwards.
    Metres(f64),
    /// The scales of a plate.
    FullScales(FullScales),
}

/// State of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Ready for commands.
    Idle,
    /// Sleeping.
    Sleeping,
    /// Measuring, zeroing or waiting for a trigger.
    Busy,
    /// An error, which only its own buttons or a restart clear.
    Error,
}

impl State {
    fn of(line: &str) -> Option<State> {
        Some(match line.to_ascii_uppercase().as_str() {
            "IDLE" => State::Idle,
            "SLEEP" => State::Sleeping,
            "EXT" | "LEVEL" | "MEASURE" | "ZERO" | "8AX" | "12AX" => State::Busy,
            error if error.contains("ERR") => State::Error,
            _ => return None,
        })
    }
}

/// Full-scale values of a plate in each range: N, N, N, N m, N m, N m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FullScales([[f64; CHANNELS]; 3]);

impl FullScales {
    fn parse(text: &str) -> Option<FullScales> {
        let mut numbers = text.split(',').map(|number| number.trim().parse::<f64>().ok());
        let mut scales = [[0.0; CHANNELS]; 3];
        for scale in scales.as_flattened_mut() {
            *scale = numbers.next()??;
            // A full scale of zero would make every force zero.
            (scale.is_finite() && *scale > 0.0).then_some(())?;
        }
        numbers.next().is_none().then_some(FullScales(scales))
    }

    /// Converts a sample's counts to force x, y, z, N, and moment x, y, z, N m.
    pub fn scaled(&self, range: Range, counts: [i16; CHANNELS]) -> [f64; CHANNELS] {
        let scales = self.0[range as usize];
        core::array::from_fn(|channel| f64::from(counts[channel]) * scales[channel] / FULL_SCALE_COUNTS)
    }
}

/// Size of a block of this many plates, bytes.
pub fn block_size(plates: u32, rate: Rate) -> usize {
    SAMPLE_SIZE * rate.block_samples as usize * plates as usize
}

/// The samples of one plate, counted from 0, in a block: all of the first plate precede those of the second.
pub fn plate_samples(block: &[u8], plate: u32, rate: Rate) -> impl Iterator<Item = [i16; CHANNELS]> {
    let size = block_size(1, rate);
    let own = block.chunks_exact(size).nth(plate as usize).unwrap_or_default();
    own.chunks_exact(SAMPLE_SIZE).map(|sample| {
        let mut reader = Reader::new(sample);
        // The chunk contains twelve bytes.
        core::array::from_fn(|_| reader.array().map(i16::from_le_bytes).unwrap_or_default())
    })
}

// bytes   block, for each plate, for each sample        line                    answer
// 0–1     force x i16, little-endian                    STATE                   IDLE, SLEEP, MEASURE, …
// 2–3     force y                                       SPS_1K                  SPS_OK
// 4–5     force z                                       FPCOUNT                 FPCOUNT_2
// 6–7     moment x                                      FPSERIAL_0              FPSERIAL_0_106
// 8–9     moment y                                      FP_0106_GET_AZ0         AZ0_-0.037
// 10–11   moment z                                      FP_0106_GETFS           FS_ and 18 numbers, three ranges of six

#[cfg(test)]
mod tests;
