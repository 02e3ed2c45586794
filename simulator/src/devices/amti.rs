//! An AMTI plate, or two at one box, on a serial line.

use std::io;

use super::felt::{Felt, Mounting};
use super::line::Line;
use super::{Asked, Device, Suffered};
use crate::dynamics::Wrench;
use crate::faults::Faults;
use crate::wires::amti::{Dialogue, Gauges, frame};

/// The box with its plates.
pub struct Amti {
    line: Line,
    dialogue: Dialogue,
    gauges: Gauges,
    mounting: Mounting,
}

impl Amti {
    /// A box with one or two plates of the same kind.
    pub fn new(line: Line, plates: u8, mounting: Mounting) -> Amti {
        let dialogue = Dialogue::new(plates);
        let mut device = Amti { line, dialogue, gauges: Gauges::ORDINARY, mounting };
        device.line.port().set_baud(device.dialogue.baud);
        device
    }
}

impl Device for Amti {
    fn poll(&mut self, _device_now_s: f64) -> io::Result<Asked> {
        let zeroed = self.dialogue.zeroed;
        for byte in self.line.port().hear()? {
            if let Some(answer) = self.dialogue.hear(byte) {
                self.line.answer(&[answer])?;
            }
            self.line.port().set_baud(self.dialogue.baud);
        }
        Ok(Asked { zero: self.dialogue.zeroed != zeroed })
    }

    fn rate_hz(&self) -> f64 {
        self.dialogue.rate_hz
    }

    fn measure(&mut self, felt: &Felt) -> io::Result<()> {
        if !self.dialogue.streaming {
            return Ok(());
        }
        let plate = |Wrench { force_n, moment_nm }: &Wrench| {
            frame(self.gauges.counts((*force_n).into(), (*moment_nm).into()), false)
        };
        let plates = usize::from(self.dialogue.plates);
        let bytes: Vec<u8> = felt.plates.iter().take(plates).flat_map(plate).collect();
        self.line.send(&bytes, 1)
    }

    fn suffered(&self) -> Suffered {
        self.line.suffered()
    }

    fn set_faults(&mut self, faults: Faults) {
        self.line.set_faults(faults);
    }

    fn unplug(&mut self) {
        self.line.port().unplug();
    }

    fn plug(&mut self) -> io::Result<()> {
        self.dialogue = Dialogue::new(self.dialogue.plates);
        self.line.port().set_baud(self.dialogue.baud);
        self.line.port().plug()
    }

    fn config(&self) -> String {
        let [keys, sections] = self.line.config("ground");
        let rows: Vec<String> = self.gauges.matrix().iter().map(|row| format!("  {row:?},\n")).collect();
        format!(
            "[ground]\nsource = \"amti-serial\"\n{keys}{}\n{sections}\n[ground.amti]\nrate_hz = 100\nforce_unit = \"N\"\n\
             moment_unit = \"N m\"\nmatrix = [\n{}]\n",
            self.mounting.config("ground"),
            rows.concat(),
        )
    }
}
