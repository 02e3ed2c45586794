//! Tec Gihan's force plate controller: lines of ASCII, then raw blocks of little-endian 16-bit numbers, each on
//! request.
//!
//! After the makers' public client `forceplate-python`. No header, no check sum.

/// Baud rate of the line.
pub const BAUD: u32 = 1_000_000;
/// Counts of the full scale.
const FULL_COUNTS: f64 = 30_000.0;

/// Names of the rates, and samples of a block.
const RATES: [(&str, f64, usize); 8] = [
    ("10K", 10_000.0, 100),
    ("5K", 5_000.0, 100),
    ("2.5K", 2_500.0, 100),
    ("1K", 1_000.0, 100),
    ("500", 500.0, 100),
    ("250", 250.0, 100),
    ("240", 240.0, 24),
    ("120", 120.0, 12),
];
const RANGES: [&str; 3] = ["3kN", "6kN", "10kN"];

/// Data of a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateInfo {
    /// Serial number.
    pub serial: u32,
    /// From the middle of the sensors to the surface, m.
    pub az0_m: f64,
    /// Full scale of Fx Fy Fz (N) Mx My Mz (N m) in each range.
    pub full_scale: [[f64; 6]; 3],
}

impl PlateInfo {
    /// A plate with the makers' own full scales.
    pub fn new(serial: u32, az0_m: f64) -> PlateInfo {
        PlateInfo {
            serial,
            az0_m,
            full_scale: [
                [1500.0, 1500.0, 3000.0, 300.0, 300.0, 200.0],
                [3000.0, 3000.0, 6000.0, 600.0, 600.0, 400.0],
                [5000.0, 5000.0, 10_000.0, 1000.0, 1000.0, 600.0],
            ],
        }
    }

    /// The numbers of one sample in a range; beyond the range they saturate.
    pub fn counts(&self, range: usize, wrench: [f64; 6]) -> [i16; 6] {
        core::array::from_fn(|channel| {
            (wrench[channel] / self.full_scale[range][channel] * FULL_COUNTS).round() as i16
        })
    }
}

/// A block: all samples of the first plate, then those of the next.
pub fn block(plates: &[Vec<[i16; 6]>]) -> Vec<u8> {
    plates.iter().flatten().flatten().flat_map(|count| count.to_le_bytes()).collect()
}

/// State of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Idle.
    Idle,
    /// Measuring.
    Measure,
    /// Waiting for its trigger.
    Waiting,
}

/// The controller's side of the dialogue.
#[derive(Debug, Clone, PartialEq)]
pub struct Dialogue {
    /// The plates at it.
    pub plates: Vec<PlateInfo>,
    /// Its state.
    pub state: State,
    /// Blocks requested and not yet sent: the first by `START`, each further by `DT`.
    pub owed: u32,
    /// Number of zeroings.
    pub zeroed: u32,
    rate: usize,
    range: usize,
    line: Vec<u8>,
}

impl Dialogue {
    /// A controller after power-on: 1000 Hz, 3 kN.
    pub fn new(plates: Vec<PlateInfo>) -> Dialogue {
        Dialogue { plates, state: State::Idle, owed: 0, zeroed: 0, rate: 3, range: 0, line: Vec::new() }
    }

    /// Samples a second.
    pub fn rate_hz(&self) -> f64 {
        RATES[self.rate].1
    }

    /// Samples of a block.
    pub fn samples_of_a_block(&self) -> usize {
        RATES[self.rate].2
    }

    /// The active range, an index of [`PlateInfo::full_scale`].
    pub fn range(&self) -> usize {
        self.range
    }

    /// Processes a byte of the host; returns the answer.
    pub fn receive(&mut self, byte: u8) -> Option<String> {
        if byte != b'\n' {
            self.line.push(byte);
            return None;
        }
        let line = String::from_utf8_lossy(&std::mem::take(&mut self.line)).trim().to_owned();
        self.execute(&line).map(|answer| answer + "\n")
    }

    fn execute(&mut self, line: &str) -> Option<String> {
        if let Some(rate) = line.strip_prefix("SPS_") {
            self.rate = RATES.iter().position(|(name, ..)| *name == rate)?;
            return Some("SPS_OK".into());
        }
        if let Some(range) = line.strip_prefix("RANGE_") {
            // Accepted without an answer.
            self.range = RANGES.iter().position(|name| *name == range).unwrap_or(self.range);
            return None;
        }
        if let Some(index) = line.strip_prefix("FPSERIAL_") {
            let plate = self.plates.get(index.parse::<usize>().ok()?)?;
            return Some(format!("{line}_{:04}", plate.serial));
        }
        if let Some(asked) = line.strip_prefix("FP_") {
            let (serial, what) = asked.split_once('_')?;
            let serial: u32 = serial.parse().ok()?;
            let plate = self.plates.iter().find(|plate| plate.serial == serial)?;
            return match what {
                "GET_AZ0" => Some(format!("AZ0_{}", plate.az0_m)),
                "GETFS" => {
                    let scales: Vec<_> = plate.full_scale.iter().flatten().map(f64::to_string).collect();
                    Some(format!("FS_{}", scales.join(",")))
                }
                _ => None,
            };
        }
        match line {
            "STATE" => Some(
                match self.state {
                    State::Idle => "IDLE",
                    State::Measure => "MEASURE",
                    State::Waiting => "EXT",
                }
                .into(),
            ),
            "SERIAL" => Some("SERIAL_1234".into()),
            "VER" => Some("VER_1.00".into()),
            "SPS" => Some(format!("SPS_{}", RATES[self.rate].0)),
            "RANGE" => Some(format!("RANGE_{}", RANGES[self.range])),
            "FPCOUNT" => Some(format!("FPCOUNT_{}", self.plates.len())),
            "START" => self.measure(State::Measure, 1),
            "EXT" | "LEVEL" => self.measure(State::Waiting, 0),
            "STOP" => self.measure(State::Idle, 0),
            "DT" if self.state == State::Measure => self.measure(State::Measure, self.owed + 1),
            "ZERO" if self.state == State::Idle => {
                self.zeroed += 1;
                None
            }
            _ => None,
        }
    }

    fn measure(&mut self, state: State, owed: u32) -> Option<String> {
        (self.state, self.owed) = (state, owed);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_learns_the_plate_and_polls_blocks() {
        let mut controller = Dialogue::new(vec![PlateInfo::new(106, -0.042)]);
        let mut say =
            |text: &str| text.bytes().filter_map(|byte| controller.receive(byte)).collect::<String>();
        assert_eq!(say("STATE\nFPCOUNT\nFPSERIAL_0\n"), "IDLE\nFPCOUNT_1\nFPSERIAL_0_0106\n");
        assert_eq!(say("FP_0106_GET_AZ0\n"), "AZ0_-0.042\n");
        let scales = say("FP_0106_GETFS\n");
        assert!(
            scales.starts_with("FS_1500,1500,3000,300,300,200,3000,") && scales.matches(',').count() == 17
        );
        assert_eq!(say("SPS_240\nRANGE_6kN\nSPS\n"), "SPS_OK\nSPS_240\n");
        assert_eq!(say("START\nSTATE\n"), "MEASURE\n");
        assert_eq!(say("DT\nDT\n"), "");
        assert_eq!((controller.owed, controller.samples_of_a_block(), controller.range()), (3, 24, 1));
    }
}
