//! Xsens MVN as a device: it streams a person's frames over UDP, or over TCP to a listening host.

use std::io;

use super::felt::Felt;
use super::line::Line;
use super::{Asked, Device, Suffered};
use crate::faults::Faults;
use crate::wire::SuitFrame;

/// The suit's frame at a simulated time (s), with its own counter and time (ms).
pub type See = Box<dyn Fn(f64, u32, u32) -> SuitFrame + Send>;

/// MVN.
pub struct Mvn {
    line: Line,
    rate_hz: f64,
    see: See,
    /// Datagrams with identity and calibration, sent once a second.
    introduction: Vec<Vec<u8>>,
    tcp: bool,
}

impl Mvn {
    /// MVN at the end of a line (TCP or UDP) that sends the frames of `see`.
    pub fn new(mut line: Line, rate_hz: f64, see: See, introduction: Vec<Vec<u8>>) -> Mvn {
        let tcp = !line.port().keeps_boundaries();
        Mvn { line, rate_hz, see, introduction, tcp }
    }
}

impl Device for Mvn {
    fn poll(&mut self, _device_now_s: f64) -> io::Result<Asked> {
        let _nothing_is_said_to_it = self.line.port().hear()?;
        Ok(Asked::default())
    }

    fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    fn measure(&mut self, felt: &Felt) -> io::Result<()> {
        if felt.number.is_multiple_of(self.rate_hz.round().max(1.0) as u32) {
            for datagram in &self.introduction {
                self.line.answer(datagram)?;
            }
        }
        let frame = (self.see)(felt.time_s, felt.number, (felt.device_s * 1000.0) as u32);
        // Its first datagram is the pose; the others alone are no sample.
        let datagrams = frame.datagrams().map_err(io::Error::other)?;
        for (samples, datagram) in [1].into_iter().chain(core::iter::repeat(0)).zip(datagrams) {
            self.line.send(&datagram, samples)?;
        }
        Ok(())
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
        let [keys, _] = self.line.config("suit");
        format!("[suit]\nsource = \"mvn-{}\"\n{keys}", if self.tcp { "tcp" } else { "udp" })
    }
}
