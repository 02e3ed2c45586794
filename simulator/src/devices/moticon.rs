//! Moticon's insoles, in the data stream of their software.

use core::fmt::Write;
use std::io;

use super::line::Line;
use super::load::{InsoleLoad, LoadSample};
use super::{Connected, Protocol};
use crate::wires::moticon::{Channel, Insole, datagram};

/// Insoles, phone and software in one.
pub struct Moticon {
    channels: Vec<Channel>,
    rate_hz: f64,
    /// Length and width of the soles, m.
    size_m: [f64; 2],
}

impl Moticon {
    /// Insoles of a size (length, width, m) with the selected channels.
    pub fn new(line: Line, channels: &[Channel], rate_hz: f64, size_m: [f64; 2]) -> Connected<Moticon> {
        Connected::new(Moticon { channels: channels.to_vec(), rate_hz, size_m }, line)
    }
}

/// Data of one sole: its load and centre of pressure, spread evenly over sixteen cells, at rest. Both insoles count y
/// towards the outer edge; the direction of Moticon's y axis is undocumented.
fn insole(sole: &InsoleLoad, outward: f64) -> Insole {
    let [length, width] = sole.size_m;
    let area_cm2 = length * width * 1e4;
    Insole {
        acceleration_g: [0.0, 0.0, 1.0],
        turning_deg_per_s: [0.0; 3],
        cop: [sole.cop_m.x / length, outward * sole.cop_m.y / width],
        pressure: [sole.normal_n / area_cm2; 16],
        force_n: sole.normal_n,
    }
}

impl Protocol for Moticon {
    fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    fn measure(&mut self, line: &mut Line, sample: &LoadSample) -> io::Result<()> {
        // The insole fits the foot: its size equals the sole's.
        let [left, right] = sample.soles.map(|sole| InsoleLoad { size_m: self.size_m, ..sole });
        let feet = [insole(&left, 1.0), insole(&right, -1.0)];
        line.send(datagram(sample.device_s, &feet, &self.channels).as_bytes(), 1)
    }

    fn config(&self, line: &Line) -> String {
        let [keys, _] = line.config();
        let [length, width] = self.size_m;
        let mut text = format!("[ground]\nsource = \"moticon-udp\"\n{keys}\n[ground.moticon]\n");
        // Writing into a string cannot fail.
        let _ = write!(text, "length_m = {length:?}\nwidth_m = {width:?}\ny_to = \"lateral\"\n");
        text
    }
}
