//! One destination address of datagrams.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use tracing::{info, warn};

/// Retry interval for a socket that cannot be created (no route, network not up yet); a peer that refused counts as
/// absent for the same time.
const TRY_AGAIN_AFTER: Duration = Duration::from_secs(1);

/// An address, and the state of sending to it.
#[derive(Debug)]
pub(super) struct Peer {
    address: SocketAddr,
    socket: Option<UdpSocket>,
    opened: Option<Instant>,
    failed: Option<Instant>,
    troubled: bool,
    /// Datagrams handed to the network.
    pub(super) sent: u64,
    /// Datagrams that were refused, or not accepted by the network.
    pub(super) lost: u64,
}

impl Peer {
    pub(super) fn new(address: SocketAddr) -> Peer {
        Peer { address, socket: None, opened: None, failed: None, troubled: false, sent: 0, lost: 0 }
    }

    /// Hands a datagram to the network, or counts it as lost; never blocks.
    pub(super) fn send(&mut self, bytes: &[u8]) {
        let outcome = self.try_send(bytes);
        let outcome = match outcome {
            // The error refers to an earlier datagram; this one was not sent yet.
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
                self.fail(&error);
                self.try_send(bytes)
            }
            other => other,
        };
        match outcome {
            Ok(()) => {
                self.sent += 1;
                if self.troubled && self.takes() {
                    self.troubled = false;
                    info!("{} takes datagrams again", self.address);
                }
            }
            Err(error) => {
                self.fail(&error);
                if wants_another_socket(error.kind()) {
                    self.socket = None;
                }
            }
        }
    }

    /// Whether no datagram was refused recently.
    pub(super) fn takes(&self) -> bool {
        self.socket.is_some() && self.failed.is_none_or(|failed| failed.elapsed() >= TRY_AGAIN_AFTER)
    }

    fn try_send(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        if self.socket.is_none() {
            self.open()?;
        }
        let Some(socket) = &self.socket else { return Err(ErrorKind::NotConnected.into()) };
        socket.send(bytes).map(|_| ())
    }

    /// The socket is connected, so that the kernel reports refusals by the peer.
    fn open(&mut self) -> std::io::Result<()> {
        if self.opened.is_some_and(|opened| opened.elapsed() < TRY_AGAIN_AFTER) {
            return Ok(());
        }
        self.opened = Some(Instant::now());
        let any: SocketAddr = match self.address {
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let socket = UdpSocket::bind(any)?;
        socket.set_nonblocking(true)?;
        socket.connect(self.address)?;
        self.socket = Some(socket);
        Ok(())
    }

    fn fail(&mut self, error: &std::io::Error) {
        self.lost += 1;
        self.failed = Some(Instant::now());
        if !self.troubled {
            self.troubled = true;
            warn!("{} does not take datagrams: {error}; is its program running? It is sent on", self.address);
        }
    }
}

/// A connected socket keeps its source address: after a change of this machine's address it can never send again. A
/// peer that refuses, or has no buffer space now, can still be reached.
fn wants_another_socket(error: ErrorKind) -> bool {
    !matches!(error, ErrorKind::ConnectionRefused | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listener() -> (UdpSocket, SocketAddr) {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(90))).unwrap();
        let address = socket.local_addr().unwrap();
        (socket, address)
    }

    #[test]
    fn a_socket_that_cannot_send_is_replaced_and_one_that_is_refused_is_kept() {
        let (listener, address) = listener();
        let mut peer = Peer::new(address);
        peer.send(b"one");
        // Simulates a change of this machine's address: every send on this socket fails, with EDESTADDRREQ.
        let lame = UdpSocket::bind("127.0.0.1:0").unwrap();
        peer.socket = Some(lame);
        peer.send(b"lost");
        assert!(peer.socket.is_none());
        assert_eq!((peer.sent, peer.lost), (1, 1));
        // The socket is reopened only after a second, which a stall of this test must not reach.
        peer.opened = Some(Instant::now() + Duration::from_secs(3600));
        peer.send(b"lost");
        assert_eq!((peer.sent, peer.lost), (1, 2));
        peer.opened = None;
        peer.send(b"two");
        let mut bytes = [0; 10];
        for sent in [b"one", b"two"] {
            let count = listener.recv(&mut bytes).unwrap();
            assert_eq!(&bytes[..count], sent);
        }
        drop(listener);
        for _ in 0..3 {
            peer.send(b"refused");
            assert!(peer.socket.is_some());
        }
        assert!(peer.lost > 2);
    }
}
