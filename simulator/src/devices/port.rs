//! A connection between a device and a host, device side.

use std::io;

/// The device's end of a serial line, a TCP connection or a UDP socket.
pub trait Port: Send {
    /// Bytes received from the host since the last call; accepts a pending connection.
    ///
    /// # Errors
    /// Errors of the operating system; an absent host is no error.
    fn receive(&mut self) -> io::Result<Vec<u8>>;

    /// Whether a host is connected.
    fn is_open(&self) -> bool;

    /// Increments with every new host: settings agreed with the previous one are void.
    fn session(&self) -> u64;

    /// Sends bytes unchanged; does nothing without a host. Bytes that a slow host does not accept are lost.
    ///
    /// # Errors
    /// As [`Self::receive`].
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Whether each call of [`Self::write`] is a separate datagram.
    fn keeps_boundaries(&self) -> bool {
        false
    }

    /// Sets the baud rate of the device's end; only a serial line has one.
    fn set_baud(&mut self, _baud: u32) {}

    /// Closes the connection, where there is one, from the device's side.
    fn hang_up(&mut self) {}

    /// Disconnects the device.
    fn unplug(&mut self);

    /// Reconnects it under the same name.
    ///
    /// # Errors
    /// The name is in use by now.
    fn plug(&mut self) -> io::Result<()>;

    /// Its kind in a configuration: `serial`, `tcp`, `udp`.
    fn kind(&self) -> &'static str;

    /// The configuration keys for this connection in two parts: those of the device's section, and further sections.
    fn config(&self) -> [String; 2];
}
