//! A home-made plate that writes lines, on a serial line, over TCP or as datagrams.

use std::io;

use super::line::Line;
use super::load::{LoadSample, Mounting};
use super::{Connected, Protocol};
use crate::wires::text::Style;

/// The plate: lines of number, time (ms), Fx Fy Fz Mx My Mz.
pub struct Text {
    style: Style,
    rate_hz: f64,
    mounting: Mounting,
}

/// Baud rate of its serial line.
const BAUD: u32 = 115_200;

impl Text {
    /// A plate that writes in this style.
    pub fn new(mut line: Line, style: Style, rate_hz: f64, mounting: Mounting) -> Connected<Text> {
        line.port().set_baud(BAUD);
        Connected::new(Text { style, rate_hz, mounting }, line)
    }
}

impl Protocol for Text {
    fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    fn measure(&mut self, line: &mut Line, sample: &LoadSample) -> io::Result<()> {
        let Some(wrench) = sample.plates.first() else { return Ok(()) };
        let [fx, fy, fz, mx, my, mz] = wrench.components();
        let fields = [sample.device_s * 1000.0, fx, fy, fz, mx, my, mz];
        line.send(self.style.line(sample.number, &fields).as_bytes(), 1)
    }

    fn config(&self, line: &Line) -> String {
        let delimiter = match self.style.delimiter {
            ',' => "comma",
            ';' => "semicolon",
            '\t' => "tab",
            _ => "spaces",
        };
        format!(
            "{}\n[ground.text]\ntransport = \"{}\"\ndelimiter = \"{delimiter}\"\ndecimal = \"{}\"\nprefix = {:?}\n\
             columns = [\"number\", \"time\", \"fx\", \"fy\", \"fz\", \"mx\", \"my\", \"mz\"]\n\
             time = {{ column = \"time\", unit = \"ms\" }}\nsequence = {{ column = \"number\" }}\n\n\
             [ground.channels.wrench]\nforce = \"N\"\nmoment = \"N m\"\n",
            self.mounting.config("text", line.config()),
            line.over(),
            self.style.decimal,
            self.style.prefix,
        )
    }
}
