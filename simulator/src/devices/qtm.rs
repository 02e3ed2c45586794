//! Qualisys Track Manager with one or two plates.

use std::io;

use super::felt::{Felt, Mounting};
use super::line::Line;
use super::{Asked, Device, Suffered};
use crate::dynamics::Wrench;
use crate::faults::Faults;
use crate::wires::qtm::{
    Command, Kind, Plate, WELCOME, command, data, force_component, force_single_component, packet,
    parameters, take_packet, text_packet,
};

/// Camera frames a second, and force samples per frame.
const FRAMES_HZ: f64 = 100.0;
const FORCES_OF_A_FRAME: u32 = 10;
/// The event of a program that terminates.
const SHUTTING_DOWN: u8 = 12;

/// The program.
pub struct Qtm {
    line: Line,
    mounting: Mounting,
    plates: usize,
    session: u64,
    heard: Vec<u8>,
    stream: Option<Stream>,
    /// Forces since the last sent frame.
    gathered: Vec<Plate>,
    frame: u32,
    forces: u32,
}

#[derive(Debug, Clone, Copy)]
struct Stream {
    every: u32,
    force: bool,
    single: bool,
}

impl Qtm {
    /// QTM with this number of plates of the same kind.
    pub fn new(line: Line, plates: usize, mounting: Mounting) -> Qtm {
        Qtm {
            line,
            mounting,
            plates,
            session: 0,
            heard: Vec::new(),
            stream: None,
            gathered: Vec::new(),
            frame: 0,
            forces: 0,
        }
    }

    fn obey(&mut self, text: &str) -> io::Result<()> {
        match command(text) {
            Command::Stream { rate_hz, divisor, force, single } => {
                let every = rate_hz.map_or(divisor.max(1), |rate_hz| (FRAMES_HZ / rate_hz).max(1.0) as u32);
                self.stream = Some(Stream { every, force, single });
                self.gathered.clear();
                Ok(())
            }
            Command::Stop => {
                self.stream = None;
                Ok(())
            }
            Command::Parameters => {
                let [x, y, _] = self.mounting.plate.origin_m.map(|metres| 1000.0 * metres);
                let corners = [
                    [x - 300.0, y - 200.0],
                    [x + 300.0, y - 200.0],
                    [x + 300.0, y + 200.0],
                    [x - 300.0, y + 200.0],
                ]
                .map(|[x, y]| [x, y, 0.0]);
                let xml = parameters(&vec![corners; self.plates]);
                self.line.answer(&text_packet(Kind::Xml, &xml))
            }
            Command::Answered(answer) => self.line.answer(&text_packet(Kind::Command, &answer)),
            Command::Unknown => self.line.answer(&text_packet(Kind::Error, "Parse error")),
        }
    }
}

/// A force in QTM's format: force, moment, and point of application on the plane of the sensor's origin, mm.
fn reported(Wrench { force_n: f, moment_nm: m }: &Wrench) -> [f32; 9] {
    let at_mm = if f.z.abs() < 5.0 { [0.0; 2] } else { [-1000.0 * m.y / f.z, 1000.0 * m.x / f.z] };
    [f.x, f.y, f.z, m.x, m.y, m.z, at_mm[0], at_mm[1], 0.0].map(|number| number as f32)
}

impl Device for Qtm {
    fn poll(&mut self, _device_now_s: f64) -> io::Result<Asked> {
        let heard = self.line.port().hear()?;
        if self.session != self.line.port().session() {
            self.session = self.line.port().session();
            self.heard.clear();
            self.stream = None;
            self.line.answer(&text_packet(Kind::Command, WELCOME))?;
        }
        self.heard.extend(heard);
        while let Some((kind, text)) = take_packet(&mut self.heard) {
            if kind == Kind::Command as u32 {
                self.obey(&text)?;
            }
        }
        Ok(Asked::default())
    }

    fn rate_hz(&self) -> f64 {
        FRAMES_HZ * f64::from(FORCES_OF_A_FRAME)
    }

    fn measure(&mut self, felt: &Felt) -> io::Result<()> {
        if self.gathered.is_empty() {
            self.gathered = (1..=self.plates as i32)
                .map(|id| Plate { id, force_number: self.forces as i32, forces: Vec::new() })
                .collect();
        }
        for (plate, wrench) in self.gathered.iter_mut().zip(&felt.plates) {
            plate.forces.push(reported(wrench));
        }
        self.forces = self.forces.wrapping_add(1);
        if !self.forces.is_multiple_of(FORCES_OF_A_FRAME) {
            return Ok(());
        }
        self.frame = self.frame.wrapping_add(1);
        let Some(Stream { every, force, single }) = self.stream else {
            self.gathered.clear();
            return Ok(());
        };
        if !self.frame.is_multiple_of(every) {
            return Ok(());
        }
        let plates = std::mem::take(&mut self.gathered);
        let mut components = Vec::new();
        if force {
            components.push(force_component(&plates));
        }
        if single {
            components.push(force_single_component(&plates));
        }
        let samples = if force { plates.first().map_or(0, |plate| plate.forces.len() as u32) } else { 1 };
        let bytes = data((felt.device_s * 1e6) as i64, self.frame, &components);
        self.line.send(&bytes, samples)
    }

    fn suffered(&self) -> Suffered {
        self.line.suffered()
    }

    fn set_faults(&mut self, faults: Faults) {
        self.line.set_faults(faults);
    }

    fn unplug(&mut self) {
        // A regular end is announced.
        let _ = self.line.answer(&packet(Kind::Event, &[SHUTTING_DOWN]));
        self.line.port().unplug();
    }

    fn plug(&mut self) -> io::Result<()> {
        self.line.port().plug()
    }

    fn config(&self) -> String {
        let [keys, _] = self.line.config("ground");
        let coordinates = if self.mounting.z_down { "plate" } else { "lab" };
        format!(
            "[ground]\nsource = \"qtm\"\n{keys}{}\n[ground.qtm]\ncoordinates = \"{coordinates}\"\n",
            self.mounting.config("ground")
        )
    }
}
