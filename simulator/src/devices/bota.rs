//! A Bota sensor on a serial line.

use std::io;

use super::felt::{Felt, Mounting};
use super::line::Line;
use super::{Asked, Device, Suffered};
use crate::faults::Faults;
use crate::wires::bota::{Dialogue, Frame};

/// The sensor.
pub struct Bota {
    line: Line,
    dialogue: Dialogue,
    mounting: Mounting,
    /// Session of the host that has received the greeting.
    greeted: u64,
}

/// Filter length for 200 samples a second.
const SINC: u32 = 256;

impl Bota {
    /// A running sensor.
    pub fn new(mut line: Line, mounting: Mounting) -> Bota {
        let dialogue = Dialogue::new(SINC);
        line.port().set_baud(dialogue.baud);
        Bota { line, dialogue, mounting, greeted: 0 }
    }
}

impl Device for Bota {
    fn poll(&mut self, _device_now_s: f64) -> io::Result<Asked> {
        let heard = self.line.port().hear()?;
        // The sensor is powered by the line and starts when it is opened.
        if self.line.is_open() && self.greeted != self.line.port().session() {
            self.greeted = self.line.port().session();
            self.line.answer(Dialogue::GREETING)?;
        }
        for byte in heard {
            if let Some(answer) = self.dialogue.hear(byte) {
                self.line.answer(answer.as_bytes())?;
            }
            self.line.port().set_baud(self.dialogue.baud);
        }
        Ok(Asked::default())
    }

    fn rate_hz(&self) -> f64 {
        self.dialogue.rate_hz()
    }

    fn measure(&mut self, felt: &Felt) -> io::Result<()> {
        let Some(wrench) = felt.plates.first().filter(|_| self.dialogue.running) else { return Ok(()) };
        let [force, moment] = [wrench.force_n, wrench.moment_nm];
        let frame = Frame {
            status: 0,
            wrench: [force.x, force.y, force.z, moment.x, moment.y, moment.z].map(|number| number as f32),
            timestamp_us: (felt.device_s * 1e6) as u64 as u32,
            temperature_c: 31.25,
        };
        self.line.send(&frame.to_bytes(), 1)
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
        self.dialogue = Dialogue::new(SINC);
        self.line.port().set_baud(self.dialogue.baud);
        self.line.port().plug()
    }

    fn config(&self) -> String {
        let [keys, sections] = self.line.config("ground");
        format!(
            "[ground]\nsource = \"bota-serial\"\n{keys}{}\n{sections}\n[ground.bota]\nsinc = {SINC}\n",
            self.mounting.config("ground")
        )
    }
}
