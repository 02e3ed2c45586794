//! UDP: the device sends unsolicited to a given address.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};

use super::port::Port;

/// The device's sending end.
#[derive(Debug)]
pub struct UdpPort {
    target: SocketAddr,
    socket: Option<UdpSocket>,
}

impl UdpPort {
    /// Sends to an address.
    ///
    /// # Errors
    /// Those of the socket.
    pub fn to(target: SocketAddr) -> io::Result<UdpPort> {
        let mut port = UdpPort { target, socket: None };
        port.plug()?;
        Ok(port)
    }
}

impl Port for UdpPort {
    fn receive(&mut self) -> io::Result<Vec<u8>> {
        Ok(Vec::new())
    }

    fn is_open(&self) -> bool {
        self.socket.is_some()
    }

    fn session(&self) -> u64 {
        0
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let Some(socket) = &self.socket else { return Ok(()) };
        match socket.send_to(bytes, self.target) {
            // No listener: irrelevant for a sender.
            Err(error) if error.kind() != ErrorKind::ConnectionRefused => Err(error),
            _ => Ok(()),
        }
    }

    fn keeps_boundaries(&self) -> bool {
        true
    }

    fn unplug(&mut self) {
        self.socket = None;
    }

    fn plug(&mut self) -> io::Result<()> {
        if self.socket.is_none() {
            let any = if self.target.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
            self.socket = Some(UdpSocket::bind(any)?);
        }
        Ok(())
    }

    fn kind(&self) -> &'static str {
        "udp"
    }

    fn config(&self) -> [String; 2] {
        [format!("listen = \"{}\"\n", self.target), String::new()]
    }
}
