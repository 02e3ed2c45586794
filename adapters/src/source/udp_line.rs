//! UDP as a transport: with requests, or only listening.

use super::error::SourceError;
use super::transport::{Incoming, Transport};
use super::udp::{OneSender, Senders, StampedUdpSocket};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;

/// Timeout of one wait for a datagram.
const TIMEOUT: Duration = Duration::from_millis(50);

/// UDP to or from one device.
#[derive(Debug)]
pub struct UdpLine {
    local: SocketAddr,
    peer: Option<SocketAddr>,
    senders: Senders,
    key: &'static str,
    socket: Option<StampedUdpSocket>,
    sender: OneSender,
    /// Sender and arrival of the last admitted datagram.
    last: Option<(IpAddr, u64)>,
}

impl UdpLine {
    /// To a device at an address, which answers from there; `key` is the configuration key of the address for errors.
    pub fn to(address: SocketAddr, key: &'static str) -> UdpLine {
        let ip = match address.ip() {
            // Bound to loopback if the device is simulated on this computer: no other computer can reach the socket
            // then.
            ip if ip.is_loopback() => ip,
            IpAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            IpAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
        };
        let senders = Senders::Only(address.ip());
        UdpLine {
            local: SocketAddr::new(ip, 0),
            peer: Some(address),
            senders,
            key,
            socket: None,
            sender: OneSender::default(),
            last: None,
        }
    }

    /// Listens for a device that sends without request; `key` is the configuration key of the address for errors.
    pub fn listening(local: SocketAddr, senders: Senders, key: &'static str) -> UdpLine {
        UdpLine { local, peer: None, senders, key, socket: None, sender: OneSender::default(), last: None }
    }

    /// The local address, once open; with the port that the system chose if 0 was requested.
    pub fn local_address(&self) -> Option<SocketAddr> {
        self.socket.as_ref().map(StampedUdpSocket::local_address)
    }
}

fn unopened(key: &str) -> SourceError {
    SourceError::Unusable(format!("{key}: used before it was opened"))
}

impl Transport for UdpLine {
    fn open(&mut self) -> Result<(), SourceError> {
        // The old socket holds the port.
        self.socket = None;
        self.socket = Some(StampedUdpSocket::open(self.local, self.senders, TIMEOUT, self.key)?);
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError> {
        let Some(socket) = &mut self.socket else { return Err(unopened(self.key)) };
        let Some(received) = socket.receive()? else { return Ok(None) };
        let (sender, arrival_ns) = (received.sender, received.arrival_ns);
        let admitted = received.admitted
            && self.peer.is_none_or(|peer| peer.port() == sender.port())
            && self.sender.admits(sender.ip(), arrival_ns);
        self.last = admitted.then_some((sender.ip(), arrival_ns));
        Ok(Some(Incoming { bytes: received.bytes, arrival_ns, admitted }))
    }

    fn accepted(&mut self) {
        if let Some((sender, arrival_ns)) = self.last {
            self.sender.hold(sender, arrival_ns);
        }
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), SourceError> {
        let Some(peer) = self.peer else {
            let listening = format!("{}: a device that is only listened to takes no commands", self.key);
            return Err(SourceError::Unusable(listening));
        };
        let Some(socket) = &self.socket else { return Err(unopened(self.key)) };
        match socket.send_to(bytes, peer) {
            // A network that is down (cable, interface) recovers, and the silence is reported in any case.
            Err(SourceError::Send { .. }) | Ok(()) => Ok(()),
            Err(other) => Err(other),
        }
    }
}
