//! Transports of messages between threads and processes: shared memory, or one of two kinds of sockets.

use std::net::{Ipv4Addr, UdpSocket};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::time::Duration;

use equipoise_config::WaitStrategy;

/// As in [`equipoise_daemon::ingress`].
pub(crate) const WAKE_AT_LEAST: Duration = Duration::from_millis(50);

/// The contenders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Carrier {
    Bus,
    Unix,
    Udp,
}

impl Carrier {
    pub(crate) const ALL: [Carrier; 3] = [Carrier::Bus, Carrier::Unix, Carrier::Udp];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Carrier::Bus => "bus",
            Carrier::Unix => "unix",
            Carrier::Udp => "udp",
        }
    }

    pub(crate) fn named(name: &str) -> Carrier {
        let found = Carrier::ALL.into_iter().find(|carrier| carrier.name() == name);
        found.unwrap_or_else(|| panic!("no carrier is called {name}"))
    }
}

/// A datagram socket of either kind.
#[derive(Debug)]
pub(crate) enum Socket {
    Unix(UnixDatagram),
    Udp(UdpSocket),
}

impl Socket {
    /// A receiving socket, and its address; `place` is the path of a Unix socket.
    pub(crate) fn receiver(carrier: Carrier, place: &Path, waiting: WaitStrategy) -> (Socket, String) {
        let (socket, address) = match carrier {
            Carrier::Udp => {
                let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
                let address = socket.local_addr().expect("it is bound").to_string();
                (Socket::Udp(socket), address)
            }
            _ => {
                // Left over from the previous turn.
                let _ = std::fs::remove_file(place);
                let socket = UnixDatagram::bind(place).expect("a place for a socket");
                (Socket::Unix(socket), place.display().to_string())
            }
        };
        let (timeout, polls) = (Some(WAKE_AT_LEAST), waiting == WaitStrategy::Polling);
        match &socket {
            Socket::Unix(socket) => {
                socket.set_read_timeout(timeout).and_then(|()| socket.set_nonblocking(polls))
            }
            Socket::Udp(socket) => {
                socket.set_read_timeout(timeout).and_then(|()| socket.set_nonblocking(polls))
            }
        }
        .expect("a socket that was just made takes its options");
        (socket, address)
    }

    /// A socket that sends to the address and never blocks.
    pub(crate) fn sender(carrier: Carrier, address: &str) -> Socket {
        let made = match carrier {
            Carrier::Udp => UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))
                .and_then(|socket| socket.connect(address).map(|()| Socket::Udp(socket))),
            _ => UnixDatagram::unbound()
                .and_then(|socket| socket.connect(PathBuf::from(address)).map(|()| Socket::Unix(socket))),
        };
        let socket = made.expect("the receiver is there");
        match &socket {
            Socket::Unix(socket) => socket.set_nonblocking(true),
            Socket::Udp(socket) => socket.set_nonblocking(true),
        }
        .expect("a socket that was just made takes its options");
        socket
    }

    /// Sends one message; a full receiver loses it.
    pub(crate) fn send(&self, bytes: &[u8]) {
        let _ = match self {
            Socket::Unix(socket) => socket.send(bytes),
            Socket::Udp(socket) => socket.send(bytes),
        };
    }

    /// Receives one message; false if there is none.
    pub(crate) fn receive(&self, bytes: &mut [u8]) -> bool {
        let received = match self {
            Socket::Unix(socket) => socket.recv(bytes),
            Socket::Udp(socket) => socket.recv(bytes),
        };
        received.is_ok_and(|count| count == bytes.len())
    }
}
