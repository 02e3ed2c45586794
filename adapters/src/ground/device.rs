//! Ground devices, one file each: decode bytes to readings and generate the commands that each device needs. They do no
//! I/O and read no clock: the time is an argument of every call.

pub mod amti;
mod asking;
pub mod ati_rdt;
pub mod binary;
pub mod bota;
mod framing;
pub mod labamp;
pub mod lsl;
pub mod moticon;
pub mod qtm;
pub mod tec_gihan;
pub mod text;

pub use framing::Framing;

use super::reading::Decoded;

/// One kind of device at the other end of a connection (datagrams, a TCP stream, a serial line).
pub trait GroundDevice: Send {
    /// The connection was opened (again): partially received frames and unfinished exchanges are discarded.
    fn opened(&mut self, now_ns: u64);

    /// As [`Self::opened`] for a stream that begins with its source's first byte, and therefore with a complete line.
    fn opened_at_start(&mut self, now_ns: u64) {
        self.opened(now_ns);
    }

    /// Processes a whole datagram, or any piece of a stream. Never panics, for any input.
    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded);

    /// The next action of the connection; polled before each wait for bytes, at intervals of at most some tens of
    /// milliseconds, and repeatedly until the result is [`Action::Nothing`].
    fn next_action(&mut self, _now_ns: u64) -> Action {
        Action::Nothing
    }

    /// A last message before an orderly close of the connection.
    fn close_command(&mut self) -> Option<Vec<u8>> {
        None
    }

    /// The current fault of the data and its remedy, in a sentence; `None` without a fault.
    fn diagnostic(&self) -> Option<String> {
        None
    }

    /// A property that the device reports and the operator needs, in a sentence; `None` if there is none.
    fn note(&self) -> Option<String> {
        None
    }
}

/// An action that a device's decoder requests of its connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Wait for bytes.
    Nothing,
    /// Send these bytes.
    Send(Vec<u8>),
    /// Set this speed of the serial line, baud.
    Speed(u32),
    /// Close the connection and open it again, with the reason as text.
    Reopen(String),
}
