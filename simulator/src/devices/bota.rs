//! A Bota sensor on a serial line.

use std::io;

use super::line::Line;
use super::load::{LoadSample, Mounting};
use super::{Connected, HostRequests, Protocol};
use crate::wires::bota::{Dialogue, Frame};

/// The sensor.
pub struct Bota {
    dialogue: Dialogue,
    mounting: Mounting,
}

/// Filter length for 200 samples a second.
const SINC: u32 = 256;

impl Bota {
    /// A running sensor.
    pub fn new(mut line: Line, mounting: Mounting) -> Connected<Bota> {
        let dialogue = Dialogue::new(SINC);
        line.port().set_baud(dialogue.baud);
        Connected::new(Bota { dialogue, mounting }, line)
    }
}

impl Protocol for Bota {
    fn receive(
        &mut self,
        line: &mut Line,
        received: &mut Vec<u8>,
        _device_now_s: f64,
    ) -> io::Result<HostRequests> {
        line.converse(received, |byte| (self.dialogue.receive(byte), self.dialogue.baud))?;
        Ok(HostRequests::default())
    }

    fn greet(&mut self, line: &mut Line) -> io::Result<()> {
        // The sensor is powered by the line and starts when it is opened.
        line.answer(Dialogue::GREETING)
    }

    fn power(&mut self, line: &mut Line, _on: bool) -> io::Result<()> {
        self.dialogue = Dialogue::new(SINC);
        line.port().set_baud(self.dialogue.baud);
        Ok(())
    }

    fn rate_hz(&self) -> f64 {
        self.dialogue.rate_hz()
    }

    fn measure(&mut self, line: &mut Line, sample: &LoadSample) -> io::Result<()> {
        let Some(wrench) = sample.plates.first().filter(|_| self.dialogue.running) else { return Ok(()) };
        let frame = Frame {
            status: 0,
            wrench: wrench.components().map(|number| number as f32),
            timestamp_us: (sample.device_s * 1e6) as u64 as u32,
            temperature_c: 31.25,
        };
        line.send(&frame.to_bytes(), 1)
    }

    fn config(&self, line: &Line) -> String {
        let ground = self.mounting.config("bota-serial", line.config());
        format!("{ground}\n[ground.bota]\nsinc = {SINC}\n")
    }
}
