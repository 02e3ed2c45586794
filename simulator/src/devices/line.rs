//! A port with faults: packets pass through the connection's faults, and each fault is counted.

use std::io;

use super::port::Port;
use crate::faults::{Faults, FaultyStream};

pub use crate::faults::FaultCounts;

/// A port behind faults. They affect samples, not the answers of a dialogue.
pub struct Line {
    port: Box<dyn Port>,
    stream: FaultyStream,
}

impl Line {
    /// A connection without faults so far.
    pub fn new(port: Box<dyn Port>, seed: u64) -> Line {
        Line { port, stream: FaultyStream::new(Faults::default(), seed) }
    }

    /// The port.
    pub fn port(&mut self) -> &mut dyn Port {
        &mut *self.port
    }

    /// As [`Port::config`].
    pub fn config(&self) -> [String; 2] {
        self.port.config()
    }

    /// As [`Port::kind`].
    pub fn over(&self) -> &'static str {
        self.port.kind()
    }

    /// As [`Port::is_open`].
    pub fn is_open(&self) -> bool {
        self.port.is_open()
    }

    /// Sends a packet with this number of samples through the faults; does nothing without a host.
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

    /// Passes each byte to a device's dialogue and sends its answer, at the baud rate from before that byte.
    ///
    /// # Errors
    /// Those of the port.
    pub fn converse<Answer: AsRef<[u8]>>(
        &mut self,
        received: &mut Vec<u8>,
        mut dialogue: impl FnMut(u8) -> (Option<Answer>, u32),
    ) -> io::Result<()> {
        for byte in received.drain(..) {
            let (answer, baud) = dialogue(byte);
            if let Some(answer) = answer {
                self.answer(answer.as_ref())?;
            }
            self.port.set_baud(baud);
        }
        Ok(())
    }

    /// Sends an answer, complete and undamaged.
    ///
    /// # Errors
    /// Those of the port.
    pub fn answer(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.port.write(bytes)
    }

    /// Counters of the sent samples.
    pub fn fault_counts(&self) -> FaultCounts {
        self.stream.fault_counts()
    }

    /// Replaces the faults from the next packet on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.stream.set_faults(faults);
    }
}
