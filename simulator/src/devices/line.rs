//! A port with a bad day: what a device sends arrives as the faults of its way leave it, and each is counted.

use std::io;

use super::port::Port;
use crate::faults::{Faults, FaultyStream};

pub use crate::faults::Suffered;

/// A port behind faults. Samples go through them, answers of a dialogue do not.
pub struct Line {
    port: Box<dyn Port>,
    stream: FaultyStream,
}

impl Line {
    /// A way without faults yet.
    pub fn new(port: Box<dyn Port>, seed: u64) -> Line {
        Line { port, stream: FaultyStream::new(Faults::default(), seed) }
    }

    /// The port.
    pub fn port(&mut self) -> &mut dyn Port {
        &mut *self.port
    }

    /// As [`Port::config`].
    pub fn config(&self, table: &str) -> [String; 2] {
        self.port.config(table)
    }

    /// As [`Port::kind`].
    pub fn over(&self) -> &'static str {
        self.port.kind()
    }

    /// As [`Port::is_open`].
    pub fn is_open(&self) -> bool {
        self.port.is_open()
    }

    /// Sends a packet of so many samples through the faults; nothing happens without a host.
    ///
    /// # Errors
    /// Those of the port.
    pub fn send(&mut self, packet: &[u8], samples: u32) -> io::Result<()> {
        if !self.port.is_open() {
            return Ok(());
        }
        if self.port.keeps_boundaries() {
            for datagram in self.stream.datagrams(packet, samples) {
                self.port.write(&datagram)?;
            }
            return Ok(());
        }
        let bytes = self.stream.bytes(packet, samples);
        self.port.write(&bytes)
    }

    /// Sends an answer, whole and undamaged.
    ///
    /// # Errors
    /// Those of the port.
    pub fn answer(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.port.write(bytes)
    }

    /// What became of what was sent.
    pub fn suffered(&self) -> Suffered {
        self.stream.suffered()
    }

    /// Another way from the next packet on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.stream.set_faults(faults);
    }
}
