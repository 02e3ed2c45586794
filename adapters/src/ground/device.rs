//! Devices that measure the ground, one file each: bytes to readings, and what a device must be told. No socket, no
//! clock: time comes in with every call.

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

use super::reading::Taken;

/// One kind of device at the other end of a connection (datagrams, a TCP stream, a serial line).
pub trait GroundDevice: Send {
    /// The connection was opened (again): what was half read or half said is forgotten.
    fn opened(&mut self, now_ns: u64);

    /// What came: a whole datagram, or any piece of a stream. Never panics, whatever it is fed.
    fn take(&mut self, bytes: &[u8], arrival_ns: u64, taken: &mut Taken);

    /// What is to be done now; asked before each wait for bytes, at most some tens of milliseconds apart, and again until it
    /// wants nothing.
    fn wants(&mut self, _now_ns: u64) -> Want {
        Want::Nothing
    }

    /// A last message before the connection is closed in order.
    fn farewell(&mut self) -> Option<Vec<u8>> {
        None
    }

    /// What is wrong with what comes, and what to do, in a sentence; `None` while all is well.
    fn trouble(&self) -> Option<String> {
        None
    }

    /// What the device told of itself that whoever runs it should know, in a sentence; `None` if there is nothing.
    fn note(&self) -> Option<String> {
        None
    }
}

/// What a device's file wants of its connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Want {
    /// To wait for bytes.
    Nothing,
    /// To say something.
    Send(Vec<u8>),
    /// Another speed of the serial line, baud.
    Speed(u32),
    /// The connection closed and opened anew, with the reason in words.
    Reopen(String),
}
