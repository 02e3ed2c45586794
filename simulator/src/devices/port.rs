//! A way between a device and a host, as the device has it.

use std::io;

/// The device's end of a serial line, a TCP connection or a UDP socket.
pub trait Port: Send {
    /// Bytes received from the host since the last call; accepts a pending connection.
    ///
    /// # Errors
    /// Errors of the operating system; an absent host is no error.
    fn hear(&mut self) -> io::Result<Vec<u8>>;

    /// Whether a host is there to listen.
    fn is_open(&self) -> bool;

    /// Grows by one for every host that comes: what was agreed with the one before is void.
    fn session(&self) -> u64;

    /// Sends bytes as they are; nothing happens without a host. What a slow host does not take is lost.
    ///
    /// # Errors
    /// As [`Self::hear`].
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Whether each call of [`Self::write`] is a datagram of its own.
    fn keeps_boundaries(&self) -> bool {
        false
    }

    /// Speed of the device's end, baud; only a serial line has one.
    fn set_baud(&mut self, _baud: u32) {}

    /// Ends the connection, where there is one, as a device that is done with its host.
    fn hang_up(&mut self) {}

    /// Pulled out.
    fn unplug(&mut self);

    /// Back under the same name.
    ///
    /// # Errors
    /// The name was taken meanwhile.
    fn plug(&mut self) -> io::Result<()>;

    /// What it is, as a configuration says: `serial`, `tcp`, `udp`.
    fn kind(&self) -> &'static str;

    /// The keys of a configuration that lead here, for the section `table`, in two parts: those of the section itself, and
    /// sections below it.
    fn config(&self, table: &str) -> [String; 2];
}
