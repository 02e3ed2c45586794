//! A home-made plate that sends frames with a check sum, on a serial line, over TCP or as datagrams.

use std::io;

use super::felt::{Felt, Mounting};
use super::line::Line;
use super::{Asked, Device, Suffered};
use crate::faults::Faults;
use crate::wires::binary::{FRAME_LEN, Frame};

/// The plate.
pub struct Binary {
    line: Line,
    rate_hz: f64,
    mounting: Mounting,
}

/// Baud rate of its serial line.
const BAUD: u32 = 921_600;

impl Binary {
    /// A plate that sends frames at this rate.
    pub fn new(mut line: Line, rate_hz: f64, mounting: Mounting) -> Binary {
        line.port().set_baud(BAUD);
        Binary { line, rate_hz, mounting }
    }
}

impl Device for Binary {
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
        let frame = Frame {
            sequence: felt.number as u16,
            time_us: (felt.device_s * 1e6) as u64 as u32,
            wrench: [f.x, f.y, f.z, m.x, m.y, m.z].map(|number| number as f32),
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
        self.line.port().plug()
    }

    fn config(&self) -> String {
        let [keys, sections] = self.line.config("ground");
        let baud = if sections.is_empty() { String::new() } else { format!("baud = {BAUD}\n") };
        let fields: String = ["fx", "fy", "fz", "mx", "my", "mz"]
            .iter()
            .enumerate()
            .map(|(index, name)| {
                format!("  {{ name = \"{name}\", at = {}, type = \"f32\" }},\n", 8 + 4 * index)
            })
            .collect();
        format!(
            "[ground]\nsource = \"binary\"\n{keys}{}\n{sections}{baud}\n[ground.binary]\ntransport = \"{}\"\nendian = \"little\"\n\
             sync = \"a5 5a\"\nlength = {FRAME_LEN}\n\
             crc = {{ name = \"CRC-16/CCITT-FALSE\", from = 0, to = -2, at = -2 }}\n\
             sequence = {{ at = 2, type = \"u16\" }}\ntime = {{ at = 4, type = \"u32\", unit = \"us\" }}\n\
             fields = [\n{fields}]\n\n[ground.channels.wrench]\nforce = \"N\"\nmoment = \"N m\"\n",
            self.mounting.config("ground"),
            self.line.over(),
        )
    }
}
