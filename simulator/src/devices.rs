//! Devices with their protocols: the device end of each connection, over the transport of a real one.
//!
//! One file per device, on top of [`felt`] (the load on a device) and [`port`] (serial line, TCP, UDP, each through the
//! faults of [`line`](mod@line)). None has a thread or a clock: time and load are arguments of each call. [`running`]
//! paces one in a thread.

pub mod amti;
pub mod ati_rdt;
pub mod binary;
pub mod bota;
pub mod felt;
pub mod http;
pub mod labamp;
pub mod line;
pub mod lsl;
pub mod moticon;
pub mod mvn;
pub mod pair;
pub mod port;
pub mod qtm;
pub mod running;
pub mod serial;
pub mod tcp;
pub mod tcp_out;
pub mod tec_gihan;
pub mod text;
pub mod udp;

use std::io;

use self::felt::Felt;
use self::line::Suffered;
use crate::faults::Faults;

/// A device with its connection.
pub trait Device: Send {
    /// Receives requests of hosts and answers them. `device_now_s` is the time on the device's own clock.
    ///
    /// # Errors
    /// Errors of the operating system; an absent host is no error.
    fn poll(&mut self, device_now_s: f64) -> io::Result<Asked>;

    /// Sample rate by the device's clock; hosts may change it.
    fn rate_hz(&self) -> f64;

    /// Handles a new sample: sends the data that are due.
    ///
    /// # Errors
    /// As [`Self::poll`].
    fn measure(&mut self, felt: &Felt) -> io::Result<()>;

    /// Counters of the sent samples.
    fn suffered(&self) -> Suffered;

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

/// Host requests other than samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Asked {
    /// Zero the present load.
    pub zero: bool,
}
