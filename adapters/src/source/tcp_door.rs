//! A listening TCP socket for one client that streams MVN datagrams to us.
//!
//! The kernel stamps packets, not what is in them: a datagram is stamped when it was read, and all that one read brings
//! bear one stamp. The clock fit keeps to the earliest, so that this costs little as long as reads are not late.

use super::error::SourceError;
use super::udp::Senders;
use crate::clock::now_monotonic_ns;
use crate::wire::mvn::{Cut, StreamCutter};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::io::{self, Read};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::os::linux::net::TcpStreamExt;
use std::time::Duration;

/// A client that brings no datagram for so long gives way to a new one.
const CLIENT_HOLDS_NS: u64 = 1_000_000_000;
/// Bytes taken at once: 14 samples of everything.
const READ_SIZE: usize = 65_536;

/// What came.
#[derive(Debug, Clone, Copy)]
pub enum Heard<'a> {
    /// A datagram of the client.
    Datagram {
        /// What was sent.
        bytes: &'a [u8],
        /// Who sent it.
        sender: SocketAddr,
        /// When it was read, CLOCK_MONOTONIC.
        arrival_ns: u64,
    },
    /// The client's stream was out of step and is searched for the next datagram.
    LostStep,
    /// Somebody connected who may not, or beside a client that still streams. The connection was closed.
    TurnedAway(SocketAddr),
}

#[derive(Debug)]
struct Client {
    stream: TcpStream,
    address: SocketAddr,
    cutter: StreamCutter,
    /// When the last bytes were read.
    arrival_ns: u64,
    /// When it last brought a datagram, or connected.
    alive_ns: u64,
}

/// The listener, its one client, and their buffer.
#[derive(Debug)]
pub struct TcpDoor {
    listener: TcpListener,
    local: SocketAddr,
    senders: Senders,
    timeout: Duration,
    client: Option<Client>,
    buffer: Box<[u8]>,
    skipped_bytes: u64,
}

impl TcpDoor {
    /// Listens on an address. `timeout` bounds each [`Self::receive`]; `key` names the address in errors.
    ///
    /// # Errors
    /// [`SourceError::PortTaken`] or [`SourceError::Open`].
    pub fn open(
        address: SocketAddr,
        senders: Senders,
        timeout: Duration,
        key: &'static str,
    ) -> Result<TcpDoor, SourceError> {
        let failed = |error: io::Error| match error.kind() {
            io::ErrorKind::AddrInUse => SourceError::PortTaken { port: address.port(), address, key },
            _ => SourceError::Open { address, key, error },
        };
        let listener = TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let local = listener.local_addr().map_err(failed)?;
        Ok(TcpDoor {
            listener,
            local,
            senders,
            timeout,
            client: None,
            buffer: vec![0; READ_SIZE].into_boxed_slice(),
            skipped_bytes: 0,
        })
    }

    /// The address it listens on, with the port the system chose if 0 was asked for.
    pub fn local_address(&self) -> SocketAddr {
        self.local
    }

    /// Who is connected.
    pub fn client(&self) -> Option<SocketAddr> {
        self.client.as_ref().map(|client| client.address)
    }

    /// Bytes of all clients that belonged to no datagram and no text.
    pub fn skipped_bytes(&self) -> u64 {
        self.skipped_bytes + self.client.as_ref().map_or(0, |client| client.cutter.skipped_bytes())
    }

    /// Waits for one datagram, or something else worth telling; `None` after the timeout, or if what came was neither.
    ///
    /// # Errors
    /// [`SourceError::Receive`] if the listening socket itself fails. A client that fails is only gone.
    pub fn receive(&mut self) -> Result<Option<Heard<'_>>, SourceError> {
        let mut cut = self.cut();
        if cut.is_none() {
            let (streams, knocks) = self.wait()?;
            // The client first: one that closed makes room for the one that knocks.
            if streams {
                self.read();
                cut = self.cut();
            }
            if cut.is_none() && knocks {
                return Ok(self.admit()?.map(Heard::TurnedAway));
            }
        }
        Ok(match (cut, &self.client) {
            (Some(Cut::Datagram), Some(client)) => Some(Heard::Datagram {
                bytes: client.cutter.datagram(),
                sender: client.address,
                arrival_ns: client.arrival_ns,
            }),
            (Some(Cut::LostStep), _) => Some(Heard::LostStep),
            _ => None,
        })
    }

    fn cut(&mut self) -> Option<Cut> {
        let client = self.client.as_mut()?;
        let cut = client.cutter.advance();
        if cut == Some(Cut::Datagram) {
            client.alive_ns = client.arrival_ns;
        }
        cut
    }

    /// Waits until the client has sent something, or somebody knocks: which of them, if any in time.
    fn wait(&self) -> Result<(bool, bool), SourceError> {
        let mut asked = vec![PollFd::new(self.listener.as_fd(), PollFlags::POLLIN)];
        asked.extend(self.client.iter().map(|client| PollFd::new(client.stream.as_fd(), PollFlags::POLLIN)));
        let timeout =
            PollTimeout::try_from(self.timeout.max(Duration::from_millis(1))).unwrap_or(PollTimeout::MAX);
        match poll(&mut asked, timeout) {
            Ok(_) => {}
            Err(Errno::EINTR) => return Ok((false, false)),
            Err(errno) => return Err(self.failed(errno.into())),
        }
        // A hang-up or an error shows when it is read.
        let happened = |at: usize| asked.get(at).and_then(PollFd::any).unwrap_or(false);
        Ok((happened(1), happened(0)))
    }

    /// Takes in what the client sent; it is forgotten if it closed or failed.
    fn read(&mut self) {
        let Some(client) = &mut self.client else { return };
        match client.stream.read(&mut self.buffer) {
            Ok(length @ 1..) => {
                client.arrival_ns = now_monotonic_ns();
                client.cutter.push(self.buffer.get(..length).unwrap_or_default());
                // A sender that waits for an answer before its next small packet shall not wait for it long. The kernel
                // forgets this wish, and a connection that does not know it is no worse than before.
                let _ = client.stream.set_quickack(true);
            }
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
            Ok(_) | Err(_) => self.forget_client(),
        }
    }

    fn forget_client(&mut self) {
        self.skipped_bytes = self.skipped_bytes();
        self.client = None;
    }

    /// Lets the next one in; who was turned away.
    fn admit(&mut self) -> Result<Option<SocketAddr>, SourceError> {
        let (stream, address) = match self.listener.accept() {
            Ok(accepted) => accepted,
            // Whoever knocked is gone again.
            Err(error)
                if matches!(
                    error.kind(),
                    io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted | io::ErrorKind::ConnectionAborted
                ) =>
            {
                return Ok(None);
            }
            Err(error) => return Err(self.failed(error)),
        };
        let address = SocketAddr::new(address.ip().to_canonical(), address.port());
        let now_ns = now_monotonic_ns();
        let is_held =
            self.client.as_ref().is_some_and(|held| now_ns.saturating_sub(held.alive_ns) < CLIENT_HOLDS_NS);
        if is_held || !self.senders.admit(address.ip()) || stream.set_nonblocking(true).is_err() {
            return Ok(Some(address));
        }
        self.forget_client();
        let cutter = StreamCutter::new();
        self.client = Some(Client { stream, address, cutter, arrival_ns: now_ns, alive_ns: now_ns });
        Ok(None)
    }

    fn failed(&self, error: io::Error) -> SourceError {
        SourceError::Receive { address: self.local, error }
    }
}
