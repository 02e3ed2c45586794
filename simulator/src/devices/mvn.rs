//! Xsens MVN as a device: it streams a person's frames over UDP, or over TCP to a listening host.

use std::io;

use super::line::Line;
use super::load::LoadSample;
use super::{Connected, Protocol};
use crate::wire::SuitFrame;

/// The suit's frame at a simulated time (s), with its own counter and time (ms).
pub type See = Box<dyn Fn(f64, u32, u32) -> SuitFrame + Send>;

/// MVN.
pub struct Mvn {
    rate_hz: f64,
    see: See,
    /// Datagrams with identity and calibration, sent once a second.
    introduction: Vec<Vec<u8>>,
}

impl Mvn {
    /// MVN at the end of a line (TCP or UDP) that sends the frames of `see`.
    pub fn new(line: Line, rate_hz: f64, see: See, introduction: Vec<Vec<u8>>) -> Connected<Mvn> {
        Connected::new(Mvn { rate_hz, see, introduction }, line)
    }
}

impl Protocol for Mvn {
    fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    fn measure(&mut self, line: &mut Line, sample: &LoadSample) -> io::Result<()> {
        if sample.number.is_multiple_of(self.rate_hz.round().max(1.0) as u32) {
            for datagram in &self.introduction {
                line.answer(datagram)?;
            }
        }
        let frame = (self.see)(sample.time_s, sample.number, (sample.device_s * 1000.0) as u32);
        // Its first datagram is the pose; the others alone are no sample.
        let datagrams = frame.datagrams().map_err(io::Error::other)?;
        for (samples, datagram) in [1].into_iter().chain(core::iter::repeat(0)).zip(datagrams) {
            line.send(&datagram, samples)?;
        }
        Ok(())
    }

    fn config(&self, line: &Line) -> String {
        let [keys, _] = line.config();
        format!("[suit]\nsource = \"mvn-{}\"\n{keys}", line.over())
    }
}
