//! Transports: the interface that engines need of every kind of connection.

use super::error::SourceError;

/// Received data.
#[derive(Debug, Clone, Copy)]
pub struct Incoming<'a> {
    /// A whole datagram, or any piece of a stream.
    pub bytes: &'a [u8],
    /// Arrival, CLOCK_MONOTONIC: the kernel's stamp for datagrams, the time of reading for streams.
    pub arrival_ns: u64,
    /// Whether the sender is admitted. If not, `bytes` must not be used.
    pub admitted: bool,
}

/// A connection to a device: a socket, a serial line, a file. Opened, used until it fails, opened again.
pub trait Transport: Send {
    /// Opens the connection; closes an existing one first.
    ///
    /// # Errors
    /// [`SourceError::Absent`] if the device is absent now and may appear later; others if this machine cannot open it.
    fn open(&mut self) -> Result<(), SourceError>;

    /// Whether the opened connection continues with the byte after the last one received; partially received lines are
    /// then kept.
    fn goes_on(&self) -> bool {
        false
    }

    /// Whether the opened connection begins with the first byte of its source, and therefore with a complete line.
    fn begins_at_start(&self) -> bool {
        false
    }

    /// Waits briefly (tens of milliseconds) for bytes; `None` if none arrived.
    ///
    /// # Errors
    /// [`SourceError::Absent`] if the device disappeared; [`Self::open`] is called again after a pause.
    fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError>;

    /// The last received data contained an accepted sample: their sender is the device.
    fn accepted(&mut self) {}

    /// Sends bytes to the device.
    ///
    /// # Errors
    /// As [`Self::receive`].
    fn send(&mut self, bytes: &[u8]) -> Result<(), SourceError>;

    /// Changes the speed of a serial line, baud; no effect on other transports.
    ///
    /// # Errors
    /// As [`Self::receive`].
    fn set_speed(&mut self, _baud: u32) -> Result<(), SourceError> {
        Ok(())
    }
}
