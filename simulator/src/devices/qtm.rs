//! Qualisys Track Manager with one or two plates.

use std::io;

use super::line::Line;
use super::load::{LoadSample, Mounting};
use super::{Connected, HostRequests, Protocol};
use crate::dynamics::Wrench;
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
    mounting: Mounting,
    plates: usize,
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
    pub fn new(line: Line, plates: usize, mounting: Mounting) -> Connected<Qtm> {
        let qtm = Qtm { mounting, plates, stream: None, gathered: Vec::new(), frame: 0, forces: 0 };
        Connected::new(qtm, line)
    }

    fn execute(&mut self, line: &mut Line, text: &str) -> io::Result<()> {
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
                line.answer(&text_packet(Kind::Xml, &xml))
            }
            Command::Answered(answer) => line.answer(&text_packet(Kind::Command, &answer)),
            Command::Unknown => line.answer(&text_packet(Kind::Error, "Parse error")),
        }
    }
}

/// A force in QTM's format: force, moment, and point of application on the plane of the sensor's origin, mm.
fn reported(wrench: &Wrench) -> [f32; 9] {
    let [fx, fy, fz, mx, my, mz] = wrench.components();
    let [x_mm, y_mm] = if fz.abs() < 5.0 { [0.0; 2] } else { [-1000.0 * my / fz, 1000.0 * mx / fz] };
    [fx, fy, fz, mx, my, mz, x_mm, y_mm, 0.0].map(|number| number as f32)
}

impl Protocol for Qtm {
    fn greet(&mut self, line: &mut Line) -> io::Result<()> {
        self.stream = None;
        line.answer(&text_packet(Kind::Command, WELCOME))
    }

    fn power(&mut self, line: &mut Line, on: bool) -> io::Result<()> {
        // A regular end is announced.
        if on { Ok(()) } else { line.answer(&packet(Kind::Event, &[SHUTTING_DOWN])) }
    }

    fn receive(
        &mut self,
        line: &mut Line,
        received: &mut Vec<u8>,
        _device_now_s: f64,
    ) -> io::Result<HostRequests> {
        while let Some((kind, text)) = take_packet(received) {
            if kind == Kind::Command as u32 {
                self.execute(line, &text)?;
            }
        }
        Ok(HostRequests::default())
    }

    fn rate_hz(&self) -> f64 {
        FRAMES_HZ * f64::from(FORCES_OF_A_FRAME)
    }

    fn measure(&mut self, line: &mut Line, sample: &LoadSample) -> io::Result<()> {
        if self.gathered.is_empty() {
            self.gathered = (1..=self.plates as i32)
                .map(|id| Plate { id, force_number: self.forces as i32, forces: Vec::new() })
                .collect();
        }
        for (plate, wrench) in self.gathered.iter_mut().zip(&sample.plates) {
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
        let bytes = data((sample.device_s * 1e6) as i64, self.frame, &components);
        line.send(&bytes, samples)
    }

    fn config(&self, line: &Line) -> String {
        let coordinates = if self.mounting.z_down { "plate" } else { "lab" };
        let ground = self.mounting.config("qtm", line.config());
        format!("{ground}[ground.qtm]\ncoordinates = \"{coordinates}\"\n")
    }
}
