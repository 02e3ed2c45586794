//! TCP with the device as the server, where a new host replaces the previous one, or as the client, which retries until
//! it is connected.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use super::port::Port;

/// A host with more pending bytes than this has stopped reading and is disconnected.
const PENDING_MAX: usize = 1 << 20;
/// Interval between connection attempts of a client.
const RETRY_INTERVAL: Duration = Duration::from_millis(100);
/// Timeout of one attempt: a present host answers at once.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(100);

/// The present host, if there is one.
#[derive(Debug, Default)]
struct Host {
    stream: Option<TcpStream>,
    /// Bytes that it has not accepted yet.
    pending: Vec<u8>,
    /// Number of hosts so far.
    session: u64,
}

impl Host {
    fn connect(&mut self, stream: TcpStream) -> io::Result<()> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        *self = Host { stream: Some(stream), pending: Vec::new(), session: self.session + 1 };
        Ok(())
    }

    fn hang_up(&mut self) {
        self.stream = None;
        self.pending.clear();
    }

    /// Sends pending bytes; drops a host that has disconnected or stopped reading.
    fn flush(&mut self) {
        let Some(stream) = &mut self.stream else { return };
        while !self.pending.is_empty() {
            match stream.write(&self.pending) {
                Ok(count) if count > 0 => drop(self.pending.drain(..count)),
                Err(error) if error.kind() == ErrorKind::WouldBlock && self.pending.len() < PENDING_MAX => {
                    return;
                }
                Ok(_) | Err(_) => return self.hang_up(),
            }
        }
    }

    fn read(&mut self) -> Vec<u8> {
        self.flush();
        let Some(stream) = &mut self.stream else { return Vec::new() };
        let mut bytes = [0; 4096];
        match stream.read(&mut bytes) {
            Ok(length) if length > 0 => return bytes[..length].to_vec(),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Ok(_) | Err(_) => self.hang_up(),
        }
        Vec::new()
    }

    fn write(&mut self, bytes: &[u8]) {
        if self.stream.is_some() {
            self.pending.extend_from_slice(bytes);
            self.flush();
        }
    }
}

/// The device's listening end.
#[derive(Debug)]
pub struct TcpPort {
    address: SocketAddr,
    listener: Option<TcpListener>,
    host: Host,
}

impl TcpPort {
    /// Listens on an address (port 0: any free one, which is then kept).
    ///
    /// # Errors
    /// Those of the socket, for example that the address is taken.
    pub fn bind(address: SocketAddr) -> io::Result<TcpPort> {
        let mut port = TcpPort { address, listener: None, host: Host::default() };
        port.plug()?;
        Ok(port)
    }

    /// The listening address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Port for TcpPort {
    fn receive(&mut self) -> io::Result<Vec<u8>> {
        // An error is either "no peer" or a peer that has closed the connection already.
        while let Some(Ok((host, _))) = self.listener.as_ref().map(TcpListener::accept) {
            self.host.connect(host)?;
        }
        Ok(self.host.read())
    }

    fn is_open(&self) -> bool {
        self.host.stream.is_some()
    }

    fn session(&self) -> u64 {
        self.host.session
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.host.write(bytes);
        Ok(())
    }

    fn hang_up(&mut self) {
        self.host.hang_up();
    }

    fn unplug(&mut self) {
        self.host.hang_up();
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

    fn config(&self) -> [String; 2] {
        [format!("address = \"{}\"\n", self.address), String::new()]
    }
}

/// The device's connecting end.
#[derive(Debug)]
pub struct TcpOutPort {
    target: SocketAddr,
    plugged: bool,
    last_attempt: Option<Instant>,
    host: Host,
}

impl TcpOutPort {
    /// To an address.
    pub fn to(target: SocketAddr) -> TcpOutPort {
        TcpOutPort { target, plugged: true, last_attempt: None, host: Host::default() }
    }

    fn try_connect(&mut self) -> io::Result<()> {
        let due = self.last_attempt.is_none_or(|last| last.elapsed() >= RETRY_INTERVAL);
        if self.is_open() || !self.plugged || !due {
            return Ok(());
        }
        self.last_attempt = Some(Instant::now());
        TcpStream::connect_timeout(&self.target, CONNECT_TIMEOUT)
            .map_or(Ok(()), |host| self.host.connect(host))
    }
}

impl Port for TcpOutPort {
    fn receive(&mut self) -> io::Result<Vec<u8>> {
        self.try_connect()?;
        Ok(self.host.read())
    }

    fn is_open(&self) -> bool {
        self.host.stream.is_some()
    }

    fn session(&self) -> u64 {
        self.host.session
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.try_connect()?;
        self.host.write(bytes);
        Ok(())
    }

    fn unplug(&mut self) {
        self.plugged = false;
        self.host.hang_up();
    }

    fn plug(&mut self) -> io::Result<()> {
        self.plugged = true;
        Ok(())
    }

    fn kind(&self) -> &'static str {
        "tcp"
    }

    fn config(&self) -> [String; 2] {
        [format!("listen = \"{}\"\n", self.target), String::new()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// Polls until there is a result, for a bounded time.
    fn until<T>(mut poll: impl FnMut() -> Option<T>) -> T {
        for _ in 0..2000 {
            if let Some(result) = poll() {
                return result;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("no result within two seconds")
    }

    #[test]
    fn a_host_connects_exchanges_bytes_and_is_disconnected() {
        let mut port = TcpPort::bind("127.0.0.1:0".parse().unwrap()).unwrap();
        let mut host = TcpStream::connect(port.address()).unwrap();
        host.write_all(b"hello").unwrap();
        let received = until(|| Some(port.receive().unwrap()).filter(|bytes| !bytes.is_empty()));
        assert_eq!((received, port.session()), (b"hello".to_vec(), 1));
        port.write(b"here").unwrap();
        let mut reported = [0; 4];
        host.read_exact(&mut reported).unwrap();
        assert_eq!(&reported, b"here");
        port.unplug();
        assert_eq!(host.read(&mut reported).unwrap_or(0), 0);
        assert!(TcpStream::connect(port.address()).is_err());
        port.plug().unwrap();
        let _again = TcpStream::connect(port.address()).unwrap();
        until(|| port.receive().map(|_| port.is_open()).unwrap().then_some(()));
        assert_eq!(port.session(), 2);
    }
}
