//! Ways to a device: what an engine needs of each, whichever it is.

use super::error::SourceError;

/// What came over a connection.
#[derive(Debug, Clone, Copy)]
pub struct Incoming<'a> {
    /// A whole datagram, or any piece of a stream.
    pub bytes: &'a [u8],
    /// When it came, CLOCK_MONOTONIC: the kernel's stamp for datagrams, the time of reading for streams.
    pub arrival_ns: u64,
    /// Whether its sender may send. If not, `bytes` must not be used.
    pub admitted: bool,
}

/// One way to a device: a socket, a serial line, a file. Opened, used until it fails, opened again.
pub trait Transport: Send {
    /// Opens the way; whatever was open before is closed.
    ///
    /// # Errors
    /// [`SourceError::Absent`] if the device is not there now and may come; others if this machine cannot do it at all.
    fn open(&mut self) -> Result<(), SourceError>;

    /// Whether what was opened last goes on with the very byte that follows the last one received: then nothing begins anew
    /// on it, and a line that was half read is.
    fn goes_on(&self) -> bool {
        false
    }

    /// Waits a short while (tens of milliseconds) for bytes; `None` if none came.
    ///
    /// # Errors
    /// [`SourceError::Absent`] if the device went away: then [`Self::open`] is called again after a pause.
    fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError>;

    /// What was received last held a sample that was accepted: its sender is the device.
    fn accepted(&mut self) {}

    /// Says something to the device.
    ///
    /// # Errors
    /// As [`Self::receive`].
    fn send(&mut self, bytes: &[u8]) -> Result<(), SourceError>;

    /// Changes the speed of a serial line, baud; other ways have none and do nothing.
    ///
    /// # Errors
    /// As [`Self::receive`].
    fn set_speed(&mut self, _baud: u32) -> Result<(), SourceError> {
        Ok(())
    }
}
