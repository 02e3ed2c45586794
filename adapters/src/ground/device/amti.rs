//! AMTI plates with a serial line: start-up dialogue, and conversion of frames to readings with the plate's calibration
//! matrix.

mod dialogue;

use super::framing::{Framing, missing};
use super::{Action, GroundDevice};
use crate::ground::frame::Wrench;
use crate::ground::reading::{Decoded, Load, Reading, Tick};
use crate::ground::refusal::GroundRefusal;
pub use crate::units::{METRE_PER_INCH, NEWTON_PER_LBF};
use crate::wire::amti::{CHANNELS, Command, FRAME_SIZE, Frame, SPEED_FAST, SPEED_SLOW};
use crate::wire::sliding::{Sliding, StreamElement};
use dialogue::Dialogue;

/// A started plate that is silent for this long was switched off, or did not start to stream.
const SILENCE_NS: u64 = 500_000_000;
/// Set in a sample's counter while the plate's trigger input is active.
pub const TRIGGER: u32 = 1 << 31;

/// Frame rate of a plate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rate {
    /// 50 Hz, the rate that works with every adapter.
    #[default]
    Hz50,
    /// 100.
    Hz100,
    /// 200.
    Hz200,
}

impl Rate {
    fn command(self) -> Command {
        match self {
            Rate::Hz50 => Command::Rate50,
            Rate::Hz100 => Command::Rate100,
            Rate::Hz200 => Command::Rate200,
        }
    }

    fn hz(self) -> f64 {
        match self {
            Rate::Hz50 => 50.0,
            Rate::Hz100 => 100.0,
            Rate::Hz200 => 200.0,
        }
    }

    fn speed(self) -> u32 {
        if self == Rate::Hz50 { SPEED_SLOW } else { SPEED_FAST }
    }
}

/// One plate: its calibration sheet and its use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AmtiSettings {
    /// Frame rate.
    pub rate: Rate,
    /// From counts to force and moment: rows Fx, Fy, Fz, Mx, My, Mz, in the units below.
    pub matrix: [[f64; CHANNELS]; 6],
    /// The matrix' unit of force, N.
    pub force_unit_n: f64,
    /// The matrix' unit of moment, N m.
    pub moment_unit_nm: f64,
}

/// A plate with AMTI's serial protocol.
#[derive(Debug, Clone)]
pub struct Amti {
    settings: AmtiSettings,
    dialogue: Dialogue,
    stream: Sliding,
    framing: Framing,
    /// Bytes since the last frame that belong to no frame.
    skipped: usize,
    /// Arrival of the last frame.
    framed_ns: u64,
    frames: u32,
    last_ns: u64,
}

impl Amti {
    /// A plate before the start-up dialogue.
    pub fn new(settings: AmtiSettings) -> Amti {
        Amti {
            settings,
            dialogue: Dialogue::new(settings.rate),
            stream: Sliding::default(),
            framing: Framing::new(
                "an AMTI plate",
                FRAME_SIZE,
                settings.rate.speed(),
                "57600 or 115200, as its rate is",
            ),
            skipped: 0,
            framed_ns: 0,
            frames: 0,
            last_ns: 0,
        }
    }

    fn reading(&mut self, frame: &Frame) -> Reading {
        self.frames = self.frames.wrapping_add(1) & !TRIGGER;
        let AmtiSettings { matrix, force_unit_n, moment_unit_nm, .. } = &self.settings;
        let row = |index: usize, unit: f64| -> f64 {
            let row = matrix.get(index).map_or(&[][..], |row| &row[..]);
            unit * row
                .iter()
                .zip(frame.counts)
                .map(|(factor, counts)| factor * f64::from(counts))
                .sum::<f64>()
        };
        Reading {
            sequence: None,
            tick: Tick::Uncounted,
            device_counter: self.frames | if frame.trigger { TRIGGER } else { 0 },
            status: 0,
            load: Load::Wrench(Wrench {
                force_n: [0, 1, 2].map(|index| row(index, *force_unit_n)),
                moment_nm: [3, 4, 5].map(|index| row(index, *moment_unit_nm)),
            }),
        }
    }

    fn read(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        self.stream.push(bytes);
        while let Some(element) = self.stream.next(Frame::parse) {
            match element {
                StreamElement::Frame(frame) => {
                    if self.skipped > 0 {
                        let since_ns = arrival_ns.saturating_sub(self.framed_ns);
                        let frames = missing(self.skipped, FRAME_SIZE, since_ns, self.settings.rate.hz());
                        decoded.lost(u32::try_from(frames).unwrap_or(u32::MAX));
                    }
                    (self.skipped, self.framed_ns) = (0, arrival_ns);
                    self.framing.frame();
                    let reading = self.reading(&frame);
                    decoded.reading(reading);
                }
                StreamElement::Skipped { bytes, .. } => {
                    if self.skipped == 0 {
                        decoded.refuse(GroundRefusal::Garbage);
                    }
                    self.skipped += bytes;
                    self.framing.skipped(bytes);
                }
            }
        }
    }
}

impl GroundDevice for Amti {
    fn opened(&mut self, now_ns: u64) {
        self.stream.clear();
        self.framing.restart(self.settings.rate.speed());
        self.dialogue.begin(now_ns);
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        if self.dialogue.is_streaming() {
            if arrival_ns.saturating_sub(self.last_ns) > SILENCE_NS {
                // The count of frames lost in the silence is unavailable.
                decoded.restarted();
            }
            self.last_ns = arrival_ns;
            self.read(bytes, arrival_ns, decoded);
        } else if let Some(rest) = self.dialogue.ingest(bytes, arrival_ns) {
            self.stream.clear();
            self.skipped = 0;
            decoded.restarted();
            self.last_ns = arrival_ns;
            self.framed_ns = arrival_ns;
            self.read(rest, arrival_ns, decoded);
        }
    }

    fn next_action(&mut self, now_ns: u64) -> Action {
        let silent = now_ns.saturating_sub(self.last_ns) > SILENCE_NS;
        if self.dialogue.is_streaming() && (silent || self.framing.is_mismatched()) {
            self.framing.restart_count();
            self.dialogue.begin(now_ns);
        }
        self.dialogue.next_action(now_ns)
    }

    fn close_command(&mut self) -> Option<Vec<u8>> {
        Some(vec![Command::Stop as u8])
    }

    fn diagnostic(&self) -> Option<String> {
        self.dialogue.diagnostic().or_else(|| self.framing.diagnostic())
    }
}

#[cfg(test)]
mod tests;
