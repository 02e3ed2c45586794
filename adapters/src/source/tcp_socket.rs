//! Listening TCP socket for one device that streams MVN datagrams.
//!
//! The device is the client whose sample was accepted. Before that, several clients may be connected and are read, so
//! that neither an idle nor an invalid connection blocks the device.
//!
//! The kernel stamps packets, not their contents: a datagram is stamped when it was read, and all datagrams of one read
//! have the same stamp. The clock fit uses the earliest arrivals, so this matters little as long as reads are not late.

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

/// A client without an accepted sample for this long may be replaced; as in `OneSender` for datagrams.
const CLIENT_HOLDS_NS: u64 = 1_000_000_000;
/// Maximum count of clients that are read while none of them is the device; a further one closes the oldest. Allows for
/// MVN, a stale connection of it, and a few unrelated clients.
const CLIENTS_MAX: usize = 8;
/// Size of one read: 14 samples with all types.
const READ_SIZE: usize = 65_536;

/// Event of the socket.
#[derive(Debug, Clone, Copy)]
pub enum SocketEvent<'a> {
    /// A datagram of a client; if a sample of it is accepted, [`TcpSocket::accepted`] must be called.
    Datagram {
        /// The datagram.
        bytes: &'a [u8],
        /// The sender.
        sender: SocketAddr,
        /// Time of reading, CLOCK_MONOTONIC.
        arrival_ns: u64,
    },
    /// A client's stream lost synchronisation and is searched for the next datagram.
    LostStep,
    /// A client that is not admitted, that connected in addition to the device, or that exceeded the limit. The
    /// connection was closed.
    Refused(SocketAddr),
}

#[derive(Debug)]
struct Client {
    stream: TcpStream,
    address: SocketAddr,
    cutter: StreamCutter,
    /// Time of the last read.
    arrival_ns: u64,
    /// Time of the last accepted sample.
    accepted_ns: Option<u64>,
}

/// The listener, its clients, and their buffer.
#[derive(Debug)]
pub struct TcpSocket {
    listener: TcpListener,
    local: SocketAddr,
    senders: Senders,
    timeout: Duration,
    /// In the order of connection.
    clients: Vec<Client>,
    /// Index of the client of the last datagram.
    last: usize,
    buffer: Box<[u8]>,
    skipped_bytes: u64,
}

impl TcpSocket {
    /// Listens on an address. `timeout` bounds each [`Self::receive`]; `key` is the configuration key for errors.
    ///
    /// # Errors
    /// [`SourceError::PortTaken`] or [`SourceError::Open`].
    pub fn open(
        address: SocketAddr,
        senders: Senders,
        timeout: Duration,
        key: &'static str,
    ) -> Result<TcpSocket, SourceError> {
        let failed = |error: io::Error| match error.kind() {
            io::ErrorKind::AddrInUse => SourceError::PortTaken { port: address.port(), address, key },
            _ => SourceError::Open { address, key, error },
        };
        let listener = TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let local = listener.local_addr().map_err(failed)?;
        Ok(TcpSocket {
            listener,
            local,
            senders,
            timeout,
            clients: Vec::new(),
            last: 0,
            buffer: vec![0; READ_SIZE].into_boxed_slice(),
            skipped_bytes: 0,
        })
    }

    /// The local address, with the port that the system chose if 0 was requested.
    pub fn local_address(&self) -> SocketAddr {
        self.local
    }

    /// Bytes of all clients that belong to no datagram and no text.
    pub fn skipped_bytes(&self) -> u64 {
        self.skipped_bytes + self.clients.iter().map(|client| client.cutter.skipped_bytes()).sum::<u64>()
    }

    /// Waits for one datagram or another event; `None` after the timeout, or if the data were neither.
    ///
    /// # Errors
    /// [`SourceError::Receive`] if the listening socket itself fails. A client that fails is dropped without error.
    pub fn receive(&mut self) -> Result<Option<SocketEvent<'_>>, SourceError> {
        let mut cut = self.cut();
        if cut.is_none() {
            let (streams, connects) = self.wait()?;
            // Clients are read first: a closed one makes room for the next.
            self.read(&streams);
            if connects && let Some(refused) = self.admit()? {
                return Ok(Some(SocketEvent::Refused(refused)));
            }
            cut = self.cut();
        }
        Ok(match (cut, self.clients.get(self.last)) {
            (Some(Cut::Datagram), Some(client)) => Some(SocketEvent::Datagram {
                bytes: client.cutter.datagram(),
                sender: client.address,
                arrival_ns: client.arrival_ns,
            }),
            (Some(Cut::LostStep), _) => Some(SocketEvent::LostStep),
            _ => None,
        })
    }

    /// The last datagram contained an accepted sample: its client is the device, and all others are closed.
    pub fn accepted(&mut self) {
        if self.last >= self.clients.len() {
            return;
        }
        let mut device = self.clients.swap_remove(self.last);
        device.accepted_ns = Some(device.arrival_ns);
        self.close(0..self.clients.len());
        self.clients.push(device);
        self.last = 0;
    }

    /// The next datagram of any client, round-robin after the last one, so that no client starves the others.
    fn cut(&mut self) -> Option<Cut> {
        let (count, last) = (self.clients.len(), self.last);
        let (index, cut) = (1..=count).map(|step| (last + step) % count).find_map(|index| {
            let cut = self.clients.get_mut(index)?.cutter.advance()?;
            Some((index, cut))
        })?;
        self.last = index;
        Some(cut)
    }

    /// Waits until a client sends data or connects: which clients are readable, and whether one connects.
    fn wait(&self) -> Result<(Vec<bool>, bool), SourceError> {
        let mut fds = vec![PollFd::new(self.listener.as_fd(), PollFlags::POLLIN)];
        fds.extend(self.clients.iter().map(|client| PollFd::new(client.stream.as_fd(), PollFlags::POLLIN)));
        let timeout =
            PollTimeout::try_from(self.timeout.max(Duration::from_millis(1))).unwrap_or(PollTimeout::MAX);
        match poll(&mut fds, timeout) {
            Ok(_) => {}
            Err(Errno::EINTR) => return Ok((Vec::new(), false)),
            Err(errno) => return Err(self.failed(errno.into())),
        }
        // A hang-up or an error is detected by the read.
        let mut ready = fds.iter().map(|fd| fd.any().unwrap_or(false));
        let connects = ready.next().unwrap_or(false);
        Ok((ready.collect(), connects))
    }

    /// Reads the clients' data; drops clients that closed or failed.
    fn read(&mut self, streams: &[bool]) {
        // In descending order, so that dropping a client does not shift the indices of those still to be read.
        for index in (0..self.clients.len()).rev().filter(|index| streams.get(*index) == Some(&true)) {
            let Some(client) = self.clients.get_mut(index) else { continue };
            match client.stream.read(&mut self.buffer) {
                Ok(length @ 1..) => {
                    client.arrival_ns = now_monotonic_ns();
                    client.cutter.push(self.buffer.get(..length).unwrap_or_default());
                    // Reduces the delay of a sender that waits for an acknowledgement before its next small packet. The
                    // kernel resets this option, and a connection without it still works.
                    let _ = client.stream.set_quickack(true);
                }
                Err(error)
                    if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
                Ok(_) | Err(_) => self.close(index..index + 1),
            }
        }
    }

    fn close(&mut self, indices: core::ops::Range<usize>) {
        for client in self.clients.drain(indices) {
            self.skipped_bytes += client.cutter.skipped_bytes();
        }
    }

    /// Accepts the next client; returns the address of one that was refused.
    fn admit(&mut self) -> Result<Option<SocketAddr>, SourceError> {
        let (stream, address) = match self.listener.accept() {
            Ok(accepted) => accepted,
            // The client has disconnected already.
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
        let holds = |client: &Client| {
            client.accepted_ns.is_some_and(|accepted_ns| now_ns.saturating_sub(accepted_ns) < CLIENT_HOLDS_NS)
        };
        let is_held = self.clients.iter().any(holds);
        if is_held || !self.senders.admit(address.ip()) || stream.set_nonblocking(true).is_err() {
            return Ok(Some(address));
        }
        let mut refused = None;
        if self.clients.len() >= CLIENTS_MAX {
            refused = self.clients.first().map(|oldest| oldest.address);
            self.close(0..1);
            self.last = 0;
        }
        let cutter = StreamCutter::new();
        self.clients.push(Client { stream, address, cutter, arrival_ns: now_ns, accepted_ns: None });
        Ok(refused)
    }

    fn failed(&self, error: io::Error) -> SourceError {
        SourceError::Receive { address: self.local, error }
    }
}
