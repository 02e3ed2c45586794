//! Devices that answer: the other end of each wire, over the transport that a real one has.
//!
//! [`felt`] (what presses on a device) and [`port`] (serial line, TCP, UDP, each through [`line`](mod@line)'s faults) carry one file a
//! device. None has a thread or a clock: time and load come in with every call. [`running`] paces one in a thread.

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

/// A device on its wire.
pub trait Device: Send {
    /// Receives requests of hosts and answers them. `device_now_s` is the time on the device's own clock.
    ///
    /// # Errors
    /// Errors of the operating system; an absent host is no error.
    fn poll(&mut self, device_now_s: f64) -> io::Result<Asked>;

    /// Samples a second by its own clock; hosts may change it.
    fn rate_hz(&self) -> f64;

    /// One more sample was measured: sends what is due.
    ///
    /// # Errors
    /// As [`Self::poll`].
    fn measure(&mut self, felt: &Felt) -> io::Result<()>;

    /// What became of what it sent.
    fn suffered(&self) -> Suffered;

    /// The way to the host is another from now on.
    fn set_faults(&mut self, faults: Faults);

    /// Disconnects the device: closes all connections and refuses new ones.
    fn unplug(&mut self);

    /// Reconnects the device under the same name, after a power cycle: all settings of the host are reset.
    ///
    /// # Errors
    /// The name or address is in use by now.
    fn plug(&mut self) -> io::Result<()>;

    /// The section of a configuration that fits it, without where it stands.
    fn config(&self) -> String;
}

/// What hosts ask besides samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Asked {
    /// The present load is zero.
    pub zero: bool,
}
