//! TCP with the device as the client: it retries until it is connected.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::port::Port;

/// Interval between connection attempts.
const AGAIN: Duration = Duration::from_millis(100);
/// Timeout of one attempt: a present host answers at once.
const KNOCK: Duration = Duration::from_millis(100);
/// A host with more pending bytes than this has stopped reading and is disconnected.
const WAITING_MAX: usize = 1 << 20;

/// The device's connecting end.
#[derive(Debug)]
pub struct TcpOutPort {
    target: SocketAddr,
    plugged: bool,
    host: Option<TcpStream>,
    knocked: Option<Instant>,
    waiting: Vec<u8>,
    session: u64,
}

impl TcpOutPort {
    /// To an address.
    pub fn to(target: SocketAddr) -> TcpOutPort {
        TcpOutPort { target, plugged: true, host: None, knocked: None, waiting: Vec::new(), session: 0 }
    }

    fn knock(&mut self) -> io::Result<()> {
        let due = self.knocked.is_none_or(|last| last.elapsed() >= AGAIN);
        if self.host.is_some() || !self.plugged || !due {
            return Ok(());
        }
        self.knocked = Some(Instant::now());
        if let Ok(host) = TcpStream::connect_timeout(&self.target, KNOCK) {
            host.set_nonblocking(true)?;
            host.set_nodelay(true)?;
            self.host = Some(host);
            self.session += 1;
        }
        Ok(())
    }

    fn leave(&mut self) {
        self.host = None;
        self.waiting.clear();
    }
}

impl Port for TcpOutPort {
    fn hear(&mut self) -> io::Result<Vec<u8>> {
        self.knock()?;
        let Some(host) = &mut self.host else { return Ok(Vec::new()) };
        let mut bytes = [0; 4096];
        match host.read(&mut bytes) {
            Ok(length) if length > 0 => return Ok(bytes[..length].to_vec()),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Ok(_) | Err(_) => self.leave(),
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
        self.knock()?;
        let Some(host) = &mut self.host else { return Ok(()) };
        self.waiting.extend_from_slice(bytes);
        match host.write(&self.waiting) {
            Ok(count) => drop(self.waiting.drain(..count)),
            Err(error) if error.kind() == ErrorKind::WouldBlock && self.waiting.len() < WAITING_MAX => {}
            Err(_) => self.leave(),
        }
        Ok(())
    }

    fn unplug(&mut self) {
        self.plugged = false;
        self.leave();
    }

    fn plug(&mut self) -> io::Result<()> {
        self.plugged = true;
        Ok(())
    }

    fn kind(&self) -> &'static str {
        "tcp"
    }

    fn config(&self, _table: &str) -> [String; 2] {
        [format!("listen = \"{}\"\n", self.target), String::new()]
    }
}
