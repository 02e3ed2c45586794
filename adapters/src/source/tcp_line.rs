//! Outgoing TCP connection as a transport.

use super::error::SourceError;
use super::transport::{Incoming, Transport};
use crate::clock::now_monotonic_ns;
use nix::sys::socket::{
    setsockopt,
    sockopt::{KeepAlive, TcpKeepCount, TcpKeepIdle, TcpKeepInterval, TcpUserTimeout},
};
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Timeout of one wait for bytes.
const TIMEOUT: Duration = Duration::from_millis(50);
/// Connection timeout; a device on the same network accepts within this.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// A device that accepts no bytes for this long has stopped working.
const WRITE_TIMEOUT: Duration = Duration::from_secs(1);
/// A pulled cable is detected after `KEEP_IDLE_S + KEEP_COUNT * KEEP_INTERVAL_S` of silence; there is no other sign of
/// it.
const KEEP_IDLE_S: u32 = 2;
const KEEP_INTERVAL_S: u32 = 1;
const KEEP_COUNT: u32 = 3;
/// The same for sent data that are not acknowledged.
const UNCONFIRMED_MS: u32 = 5000;
/// Size of one read; a stream may arrive in pieces of any size.
const BUFFER_SIZE: usize = 65_536;

/// TCP to one device.
#[derive(Debug)]
pub struct TcpLine {
    address: SocketAddr,
    what: String,
    key: &'static str,
    stream: Option<TcpStream>,
    buffer: Box<[u8]>,
}

impl TcpLine {
    /// To a device at an address; `what` is its name for the operator, `key` the configuration key of the address for
    /// errors.
    pub fn to(address: SocketAddr, what: &str, key: &'static str) -> TcpLine {
        let buffer = vec![0; BUFFER_SIZE].into_boxed_slice();
        TcpLine { address, what: what.to_owned(), key, stream: None, buffer }
    }

    /// Sets the address of the next [`Transport::open`]; an open connection is kept until then.
    pub fn redirect(&mut self, address: SocketAddr) {
        self.address = address;
    }

    /// The local address, once open.
    pub fn local_address(&self) -> Option<SocketAddr> {
        self.stream.as_ref().and_then(|stream| stream.local_addr().ok())
    }

    /// Closes the connection, if there is one.
    pub fn close(&mut self) {
        self.stream = None;
    }

    fn connect(&self) -> io::Result<TcpStream> {
        let stream = TcpStream::connect_timeout(&self.address, CONNECT_TIMEOUT)?;
        stream.set_read_timeout(Some(TIMEOUT))?;
        stream.set_write_timeout(Some(WRITE_TIMEOUT))?;
        // Commands to a device are short and must not be delayed.
        stream.set_nodelay(true)?;
        setsockopt(&stream, KeepAlive, &true)?;
        setsockopt(&stream, TcpKeepIdle, &KEEP_IDLE_S)?;
        setsockopt(&stream, TcpKeepInterval, &KEEP_INTERVAL_S)?;
        setsockopt(&stream, TcpKeepCount, &KEEP_COUNT)?;
        setsockopt(&stream, TcpUserTimeout, &UNCONFIRMED_MS)?;
        Ok(stream)
    }

    fn absent(&self, error: io::Error) -> SourceError {
        let remedy = match error.kind() {
            io::ErrorKind::ConnectionRefused => {
                format!(
                    "the machine is there, but nothing listens on port {}: start it, or correct {}",
                    self.address.port(),
                    self.key
                )
            }
            io::ErrorKind::UnexpectedEof | io::ErrorKind::ConnectionReset => {
                "it is called again; another program may hold it, or it was restarted".to_owned()
            }
            _ => format!("is it on, is the cable in, and is {} right?", self.key),
        };
        SourceError::Absent { what: format!("{} at {}", self.what, self.address), remedy, error }
    }
}

/// A timeout or a signal: no data yet.
fn is_nothing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted)
}

impl Transport for TcpLine {
    fn open(&mut self) -> Result<(), SourceError> {
        // A device that serves only one client accepts a new connection only after the old one is closed.
        self.stream = None;
        self.stream = Some(self.connect().map_err(|error| self.absent(error))?);
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError> {
        let Some(stream) = &mut self.stream else {
            return Err(self.absent(io::ErrorKind::NotConnected.into()));
        };
        let read = match stream.read(&mut self.buffer) {
            Ok(0) => Err(io::Error::new(io::ErrorKind::UnexpectedEof, "it closed the connection")),
            // The kernel gave up the connection; a mere timeout is `WouldBlock` here.
            Err(error) if is_nothing(&error) && error.raw_os_error() != Some(nix::libc::ETIMEDOUT) => {
                return Ok(None);
            }
            read => read,
        };
        match read {
            Ok(length) => {
                let bytes = self.buffer.get(..length).unwrap_or_default();
                Ok(Some(Incoming { bytes, arrival_ns: now_monotonic_ns(), admitted: true }))
            }
            Err(error) => {
                self.stream = None;
                Err(self.absent(error))
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), SourceError> {
        let Some(stream) = &mut self.stream else {
            return Err(self.absent(io::ErrorKind::NotConnected.into()));
        };
        // A partial command is invalid, so any failure here closes the connection.
        stream.write_all(bytes).map_err(|error| {
            self.stream = None;
            self.absent(error)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;
    use std::time::Instant;

    const PATIENCE: Duration = Duration::from_secs(20);

    fn pair() -> (TcpLine, TcpListener) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let line = TcpLine::to(listener.local_addr().unwrap(), "the plate", "ground.address");
        (line, listener)
    }

    /// Reads until this many bytes have arrived, or an error.
    fn take(line: &mut TcpLine, length: usize) -> Result<Vec<u8>, SourceError> {
        let (began, mut received) = (Instant::now(), Vec::new());
        while received.len() < length && began.elapsed() < PATIENCE {
            if let Some(incoming) = line.receive()? {
                assert!(incoming.admitted && incoming.arrival_ns > 0);
                received.extend_from_slice(incoming.bytes);
            }
        }
        Ok(received)
    }

    #[test]
    fn both_ends_send_and_silence_is_no_error() {
        let (mut line, listener) = pair();
        line.open().unwrap();
        let (mut device, caller) = listener.accept().unwrap();
        assert_eq!(Some(caller), line.local_address());
        assert!(line.receive().unwrap().is_none());
        line.send(b"hello").unwrap();
        let mut received = [0; 5];
        device.read_exact(&mut received).unwrap();
        device.write_all(&received).unwrap();
        assert_eq!(take(&mut line, 5).unwrap(), b"hello");
    }

    #[test]
    fn a_device_that_hangs_up_is_absent_and_can_be_called_again() {
        let (mut line, listener) = pair();
        line.open().unwrap();
        drop(listener.accept().unwrap());
        let error = take(&mut line, 1).unwrap_err();
        assert!(error.may_recover() && error.to_string().contains("it closed the connection"), "{error}");
        assert!(line.receive().unwrap_err().may_recover() && line.send(b"x").unwrap_err().may_recover());
        line.open().unwrap();
        listener.accept().unwrap().0.write_all(b"again").unwrap();
        assert_eq!(take(&mut line, 5).unwrap(), b"again");
    }

    #[test]
    fn an_absent_device_is_reported_in_words() {
        let (mut line, listener) = pair();
        let port = listener.local_addr().unwrap().port();
        drop(listener);
        let error = line.open().unwrap_err();
        assert!(error.may_recover(), "{error:?}");
        let text = error.to_string();
        assert!(text.contains(&format!("nothing listens on port {port}")), "{text}");
        assert!(text.contains("the plate at 127.0.0.1") && text.contains("correct ground.address"), "{text}");
    }
}
