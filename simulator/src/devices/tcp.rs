//! TCP with the device as the server: one host at a time, a new one replaces the previous.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

use super::port::Port;

/// A host with more pending bytes than this has stopped reading and is disconnected.
const WAITING_MAX: usize = 1 << 20;

/// The device's listening end.
#[derive(Debug)]
pub struct TcpPort {
    address: SocketAddr,
    listener: Option<TcpListener>,
    host: Option<TcpStream>,
    waiting: Vec<u8>,
    session: u64,
}

impl TcpPort {
    /// Listens on an address (port 0: any free one, which is then kept).
    ///
    /// # Errors
    /// Those of the socket, for example that the address is taken.
    pub fn bind(address: SocketAddr) -> io::Result<TcpPort> {
        let mut port = TcpPort { address, listener: None, host: None, waiting: Vec::new(), session: 0 };
        port.plug()?;
        Ok(port)
    }

    /// The listening address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    fn let_in(&mut self) -> io::Result<()> {
        while let Some(listener) = &self.listener {
            match listener.accept() {
                Ok((host, _)) => {
                    host.set_nonblocking(true)?;
                    host.set_nodelay(true)?;
                    self.host = Some(host);
                    self.waiting.clear();
                    self.session += 1;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                // The peer has closed the connection already.
                Err(_) => break,
            }
        }
        Ok(())
    }

    /// Sends pending bytes; drops a host that has disconnected or stopped reading.
    fn flush(&mut self) {
        let Some(host) = &mut self.host else { return };
        while !self.waiting.is_empty() {
            match host.write(&self.waiting) {
                Ok(count) if count > 0 => drop(self.waiting.drain(..count)),
                Err(error) if error.kind() == ErrorKind::WouldBlock && self.waiting.len() < WAITING_MAX => {
                    return;
                }
                Ok(_) | Err(_) => return self.hang_up(),
            }
        }
    }
}

impl Port for TcpPort {
    fn hear(&mut self) -> io::Result<Vec<u8>> {
        self.let_in()?;
        self.flush();
        let Some(host) = &mut self.host else { return Ok(Vec::new()) };
        let mut bytes = [0; 4096];
        match host.read(&mut bytes) {
            Ok(length) if length > 0 => return Ok(bytes[..length].to_vec()),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Ok(_) | Err(_) => self.hang_up(),
        }
        Ok(Vec::new())
    }

    fn is_open(&self) -> bool {
        self.host.is_some()
    }

    fn session(&self) -> u64 {
        self.session
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.host.is_some() {
            self.waiting.extend_from_slice(bytes);
            self.flush();
        }
        Ok(())
    }

    fn hang_up(&mut self) {
        self.host = None;
        self.waiting.clear();
    }

    fn unplug(&mut self) {
        self.hang_up();
        self.listener = None;
    }

    fn plug(&mut self) -> io::Result<()> {
        if self.listener.is_none() {
            // The standard library's listener can bind the same address again at once (SO_REUSEADDR).
            let listener = TcpListener::bind(self.address)?;
            listener.set_nonblocking(true)?;
            self.address = listener.local_addr()?;
            self.listener = Some(listener);
        }
        Ok(())
    }

    fn kind(&self) -> &'static str {
        "tcp"
    }

    fn config(&self, _table: &str) -> [String; 2] {
        [format!("address = \"{}\"\n", self.address), String::new()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// Polls until there is a result, for a bounded time.
    fn until<Found>(mut look: impl FnMut() -> Option<Found>) -> Found {
        for _ in 0..2000 {
            if let Some(found) = look() {
                return found;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("nothing came within two seconds")
    }

    #[test]
    fn a_host_connects_exchanges_bytes_and_is_disconnected() {
        let mut port = TcpPort::bind("127.0.0.1:0".parse().unwrap()).unwrap();
        let mut host = TcpStream::connect(port.address()).unwrap();
        host.write_all(b"hello").unwrap();
        let heard = until(|| Some(port.hear().unwrap()).filter(|bytes| !bytes.is_empty()));
        assert_eq!((heard, port.session()), (b"hello".to_vec(), 1));
        port.write(b"here").unwrap();
        let mut reported = [0; 4];
        host.read_exact(&mut reported).unwrap();
        assert_eq!(&reported, b"here");
        port.unplug();
        assert_eq!(host.read(&mut reported).unwrap_or(0), 0);
        assert!(TcpStream::connect(port.address()).is_err());
        port.plug().unwrap();
        let _again = TcpStream::connect(port.address()).unwrap();
        until(|| port.hear().map(|_| port.is_open()).unwrap().then_some(()));
        assert_eq!(port.session(), 2);
    }
}
