//! An AMTI plate, or two at one box, on a serial line.

use std::io;

use super::line::Line;
use super::load::{LoadSample, Mounting};
use super::{Connected, HostRequests, Protocol};
use crate::wires::amti::{Dialogue, Gauges, frame};

/// The box with its plates.
pub struct Amti {
    dialogue: Dialogue,
    gauges: Gauges,
    mounting: Mounting,
}

impl Amti {
    /// A box with one or two plates of the same kind.
    pub fn new(mut line: Line, plates: u8, mounting: Mounting) -> Connected<Amti> {
        let dialogue = Dialogue::new(plates);
        line.port().set_baud(dialogue.baud);
        Connected::new(Amti { dialogue, gauges: Gauges::ORDINARY, mounting }, line)
    }
}

impl Protocol for Amti {
    fn receive(
        &mut self,
        line: &mut Line,
        received: &mut Vec<u8>,
        _device_now_s: f64,
    ) -> io::Result<HostRequests> {
        let Amti { dialogue, .. } = self;
        let zeroed = dialogue.zeroed;
        line.converse(received, |byte| (dialogue.receive(byte).map(|answer| [answer]), dialogue.baud))?;
        Ok(HostRequests { zero: dialogue.zeroed != zeroed })
    }

    fn power(&mut self, line: &mut Line, _on: bool) -> io::Result<()> {
        self.dialogue = Dialogue::new(self.dialogue.plates);
        line.port().set_baud(self.dialogue.baud);
        Ok(())
    }

    fn rate_hz(&self) -> f64 {
        self.dialogue.rate_hz
    }

    fn measure(&mut self, line: &mut Line, sample: &LoadSample) -> io::Result<()> {
        if !self.dialogue.streaming {
            return Ok(());
        }
        let plates = sample.plates.iter().take(usize::from(self.dialogue.plates));
        let bytes: Vec<u8> =
            plates.flat_map(|wrench| frame(self.gauges.counts(wrench.components()), false)).collect();
        line.send(&bytes, 1)
    }

    fn config(&self, line: &Line) -> String {
        let rows: Vec<String> = self.gauges.matrix().iter().map(|row| format!("  {row:?},\n")).collect();
        format!(
            "{}\n[ground.amti]\nrate_hz = 100\nforce_unit = \"N\"\nmoment_unit = \"N m\"\nmatrix = [\n{}]\n",
            self.mounting.config("amti-serial", line.config()),
            rows.concat(),
        )
    }
}
