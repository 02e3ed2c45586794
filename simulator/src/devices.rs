//! Devices with their protocols: the device end of each connection, over the transport of a real one.
//!
//! One file per device with its bytes ([`Protocol`]); [`Connected`] is the part that they share: a [`port`] (serial line,
//! TCP, UDP) through the faults of [`line`](mod@line). The load is that of [`load`]. No device has a thread or a clock:
//! time and load are arguments of each call. [`running`] paces one in a thread.

pub mod amti;
pub mod ati_rdt;
pub mod binary;
pub mod bota;
pub mod http;
pub mod labamp;
pub mod line;
pub mod load;
pub mod lsl;
pub mod moticon;
pub mod mvn;
pub mod pair;
pub mod port;
pub mod qtm;
pub mod running;
pub mod serial;
pub mod tcp;
pub mod tec_gihan;
pub mod text;
pub mod udp;

use std::io;

use self::line::{FaultCounts, Line};
use self::load::LoadSample;
use crate::faults::Faults;

/// A device with its connection.
pub trait Device: Send {
    /// Receives requests of hosts and answers them. `device_now_s` is the time on the device's own clock.
    ///
    /// # Errors
    /// Errors of the operating system; an absent host is no error.
    fn poll(&mut self, device_now_s: f64) -> io::Result<HostRequests>;

    /// Sample rate by the device's clock; hosts may change it.
    fn rate_hz(&self) -> f64;

    /// Handles a new sample: sends the data that are due.
    ///
    /// # Errors
    /// As [`Self::poll`].
    fn measure(&mut self, sample: &LoadSample) -> io::Result<()>;

    /// Counters of the sent samples.
    fn fault_counts(&self) -> FaultCounts;

    /// Replaces the faults of the connection.
    fn set_faults(&mut self, faults: Faults);

    /// Disconnects the device: closes all connections and refuses new ones.
    fn unplug(&mut self);

    /// Reconnects the device under the same name, after a power cycle: all settings of the host are reset.
    ///
    /// # Errors
    /// The name or address is in use by now.
    fn plug(&mut self) -> io::Result<()>;

    /// A matching configuration section, without the plate's pose.
    fn config(&self) -> String;
}

/// The bytes and the state of a device that sends its samples over one connection.
pub trait Protocol: Send {
    /// Handles received bytes and removes those that are complete. `device_now_s` is the time on the device's own clock.
    ///
    /// # Errors
    /// As [`Device::poll`].
    fn receive(
        &mut self,
        _line: &mut Line,
        received: &mut Vec<u8>,
        _device_now_s: f64,
    ) -> io::Result<HostRequests> {
        received.clear();
        Ok(HostRequests::default())
    }

    /// Begins the dialogue with a new host.
    ///
    /// # Errors
    /// As [`Device::poll`].
    fn greet(&mut self, _line: &mut Line) -> io::Result<()> {
        Ok(())
    }

    /// Switches the device on with its initial settings, or off; its connection opens or closes afterwards.
    ///
    /// # Errors
    /// As [`Device::plug`].
    fn power(&mut self, _line: &mut Line, _on: bool) -> io::Result<()> {
        Ok(())
    }

    /// As [`Device::rate_hz`].
    fn rate_hz(&self) -> f64;

    /// As [`Device::measure`].
    ///
    /// # Errors
    /// As [`Device::measure`].
    fn measure(&mut self, line: &mut Line, sample: &LoadSample) -> io::Result<()>;

    /// As [`Device::config`].
    fn config(&self, line: &Line) -> String;
}

/// A device of a [`Protocol`] with its connection.
pub struct Connected<P> {
    protocol: P,
    line: Line,
    /// Session of the present host.
    session: u64,
    /// Received in this session and not yet complete.
    received: Vec<u8>,
}

impl<P: Protocol> Connected<P> {
    /// At the end of a line.
    pub fn new(protocol: P, line: Line) -> Connected<P> {
        Connected { protocol, line, session: 0, received: Vec::new() }
    }
}

impl<P: Protocol> Device for Connected<P> {
    fn poll(&mut self, device_now_s: f64) -> io::Result<HostRequests> {
        let received = self.line.port().receive()?;
        let session = self.line.port().session();
        if self.line.is_open() && session != self.session {
            self.session = session;
            self.received.clear();
            self.protocol.greet(&mut self.line)?;
        }
        self.received.extend(received);
        self.protocol.receive(&mut self.line, &mut self.received, device_now_s)
    }

    fn rate_hz(&self) -> f64 {
        self.protocol.rate_hz()
    }

    fn measure(&mut self, sample: &LoadSample) -> io::Result<()> {
        self.protocol.measure(&mut self.line, sample)
    }

    fn fault_counts(&self) -> FaultCounts {
        self.line.fault_counts()
    }

    fn set_faults(&mut self, faults: Faults) {
        self.line.set_faults(faults);
    }

    fn unplug(&mut self) {
        // A device that loses power reports no errors.
        let _ = self.protocol.power(&mut self.line, false);
        self.line.port().unplug();
    }

    fn plug(&mut self) -> io::Result<()> {
        self.protocol.power(&mut self.line, true)?;
        self.line.port().plug()
    }

    fn config(&self) -> String {
        self.protocol.config(&self.line)
    }
}

/// Host requests other than samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HostRequests {
    /// Zero the present load.
    pub zero: bool,
}
