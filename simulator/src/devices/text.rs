//! A home-made plate that writes lines, on a serial line, over TCP or as datagrams.

use std::io;

use super::felt::{Felt, Mounting};
use super::line::Line;
use super::{Asked, Device, Suffered};
use crate::faults::Faults;
use crate::wires::text::Style;

/// The plate: lines of number, time (ms), Fx Fy Fz Mx My Mz.
pub struct Text {
    line: Line,
    style: Style,
    rate_hz: f64,
    mounting: Mounting,
}

/// Baud rate of its serial line.
const BAUD: u32 = 115_200;

impl Text {
    /// A plate that writes in this style.
    pub fn new(mut line: Line, style: Style, rate_hz: f64, mounting: Mounting) -> Text {
        line.port().set_baud(BAUD);
        Text { line, style, rate_hz, mounting }
    }
}

impl Device for Text {
    fn poll(&mut self, _device_now_s: f64) -> io::Result<Asked> {
        let _nothing_is_said_to_it = self.line.port().hear()?;
        Ok(Asked::default())
    }

    fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    fn measure(&mut self, felt: &Felt) -> io::Result<()> {
        let Some(wrench) = felt.plates.first() else { return Ok(()) };
        let [f, m] = [wrench.force_n, wrench.moment_nm];
        let fields = [felt.device_s * 1000.0, f.x, f.y, f.z, m.x, m.y, m.z];
        self.line.send(self.style.line(felt.number, &fields).as_bytes(), 1)
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
        self.line.port().plug()
    }

    fn config(&self) -> String {
        let [keys, sections] = self.line.config("ground");
        let delimiter = match self.style.delimiter {
            ',' => "comma",
            ';' => "semicolon",
            '\t' => "tab",
            _ => "spaces",
        };
        format!(
            "[ground]\nsource = \"text\"\n{keys}{}\n{sections}\n[ground.text]\ntransport = \"{}\"\ndelimiter = \"{delimiter}\"\n\
             decimal = \"{}\"\nprefix = {:?}\n\
             columns = [\"number\", \"time\", \"fx\", \"fy\", \"fz\", \"mx\", \"my\", \"mz\"]\n\
             time = {{ column = \"time\", unit = \"ms\" }}\nsequence = {{ column = \"number\" }}\n\n\
             [ground.channels.wrench]\nforce = \"N\"\nmoment = \"N m\"\n",
            self.mounting.config("ground"),
            self.line.over(),
            self.style.decimal,
            self.style.prefix,
        )
    }
}
