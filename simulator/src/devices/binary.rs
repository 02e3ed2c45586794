//! A home-made plate that sends frames with a check sum, on a serial line, over TCP or as datagrams.

use std::io;

use super::line::Line;
use super::load::{LoadSample, Mounting};
use super::{Connected, Protocol};
use crate::wires::binary::{FRAME_LEN, Frame};

/// The plate.
pub struct Binary {
    rate_hz: f64,
    mounting: Mounting,
}

/// Baud rate of its serial line.
const BAUD: u32 = 921_600;

impl Binary {
    /// A plate that sends frames at this rate.
    pub fn new(mut line: Line, rate_hz: f64, mounting: Mounting) -> Connected<Binary> {
        line.port().set_baud(BAUD);
        Connected::new(Binary { rate_hz, mounting }, line)
    }
}

impl Protocol for Binary {
    fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    fn measure(&mut self, line: &mut Line, sample: &LoadSample) -> io::Result<()> {
        let Some(wrench) = sample.plates.first() else { return Ok(()) };
        let frame = Frame {
            sequence: sample.number as u16,
            time_us: (sample.device_s * 1e6) as u64 as u32,
            wrench: wrench.components().map(|number| number as f32),
        };
        line.send(&frame.to_bytes(), 1)
    }

    fn config(&self, line: &Line) -> String {
        let [keys, mut sections] = line.config();
        if !sections.is_empty() {
            sections += &format!("baud = {BAUD}\n");
        }
        let fields: String = ["fx", "fy", "fz", "mx", "my", "mz"]
            .iter()
            .enumerate()
            .map(|(index, name)| {
                format!("  {{ name = \"{name}\", at = {}, type = \"f32\" }},\n", 8 + 4 * index)
            })
            .collect();
        format!(
            "{}\n[ground.binary]\ntransport = \"{}\"\nendian = \"little\"\nsync = \"a5 5a\"\nlength = {FRAME_LEN}\n\
             crc = {{ name = \"CRC-16/CCITT-FALSE\", from = 0, to = -2, at = -2 }}\n\
             sequence = {{ at = 2, type = \"u16\" }}\ntime = {{ at = 4, type = \"u32\", unit = \"us\" }}\n\
             fields = [\n{fields}]\n\n[ground.channels.wrench]\nforce = \"N\"\nmoment = \"N m\"\n",
            self.mounting.config("binary", [keys, sections]),
            line.over(),
        )
    }
}
