//! The suit's source, over UDP or TCP, for one subject or several.

use super::error::SourceError;
use super::tcp_socket::{SocketEvent, TcpSocket};
use super::udp::{OneSender, Senders, StampedUdpSocket};
use crate::clock::now_monotonic_ns;
use crate::counts::{Counts, HealthReporter, Stream};
use crate::suit::{SuitAssembler, SuitRefusal, SuitRouter, SuitSettings, SuitSubject};
use equipoise_core::message::{AdapterHealth, SuitBody, SuitSample};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

/// Maximum count of datagrams in one call, so that a flood of refused ones does not block the caller.
const MAX_DATAGRAMS_PER_CALL: usize = 64;

/// Transport of MVN's datagrams.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MvnTransport {
    /// Single datagrams.
    #[default]
    Udp,
    /// As a stream; MVN connects to this machine.
    Tcp,
}

/// Address and contents of the suit's stream.
#[derive(Debug, Clone)]
pub struct MvnSettings {
    /// Transport of the datagrams.
    pub transport: MvnTransport,
    /// The address to listen on.
    pub listen: SocketAddr,
    /// Whether computers other than this one are admitted.
    pub allow_remote: bool,
    /// Timeout of one [`SuitSource::receive`].
    pub timeout: Duration,
    /// Settings of the assembler, and the station's own character.
    pub suit: SuitSettings,
    /// Further characters on the same port.
    pub others: Vec<u8>,
}

impl MvnSettings {
    pub(super) fn senders(&self) -> Senders {
        if self.allow_remote { Senders::Anyone } else { Senders::Loopback }
    }
}

impl Default for MvnSettings {
    fn default() -> Self {
        MvnSettings {
            transport: MvnTransport::Udp,
            listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), crate::wire::mvn::DEFAULT_PORT),
            allow_remote: false,
            timeout: Duration::from_millis(100),
            suit: SuitSettings::default(),
            others: Vec::new(),
        }
    }
}

#[derive(Debug)]
enum Wire {
    /// Suits that stream from one computer.
    Udp(StampedUdpSocket, OneSender),
    Tcp(TcpSocket),
}

/// Suits that stream to this machine.
#[derive(Debug)]
pub struct SuitSource {
    wire: Wire,
    suits: SuitRouter,
    /// Health reporter of each character's stream; the station's own is the first.
    health: Vec<(u8, HealthReporter)>,
}

impl SuitSource {
    /// Starts listening.
    ///
    /// # Errors
    /// [`SourceError::PortTaken`] or [`SourceError::Open`].
    pub fn open(settings: &MvnSettings) -> Result<SuitSource, SourceError> {
        let MvnSettings { listen, timeout, .. } = *settings;
        let wire = match settings.transport {
            MvnTransport::Udp => {
                let socket = StampedUdpSocket::open(listen, settings.senders(), timeout, "suit.listen")?;
                Wire::Udp(socket, OneSender::default())
            }
            MvnTransport::Tcp => {
                Wire::Tcp(TcpSocket::open(listen, settings.senders(), timeout, "suit.listen")?)
            }
        };
        let reporter = |avatar: &u8| (*avatar, HealthReporter::new(Stream::Suit, now_monotonic_ns()));
        Ok(SuitSource {
            wire,
            suits: SuitRouter::new(settings.suit, &settings.others),
            health: [settings.suit.avatar].iter().chain(&settings.others).map(reporter).collect(),
        })
    }

    /// The address it listens on.
    pub fn local_address(&self) -> SocketAddr {
        match &self.wire {
            Wire::Udp(socket, _) => socket.local_address(),
            Wire::Tcp(socket) => socket.local_address(),
        }
    }

    /// Waits for one sample, whose `avatar` identifies the character; `None` after the timeout, or if the data
    /// completed no sample.
    ///
    /// # Errors
    /// [`SourceError::Receive`] if the socket itself fails.
    pub fn receive(&mut self) -> Result<Option<SuitSample>, SourceError> {
        if let Some(sample) = self.suits.take_ready() {
            return Ok(Some(sample));
        }
        match &mut self.wire {
            Wire::Udp(socket, sender) => receive_udp(socket, sender, &mut self.suits),
            Wire::Tcp(socket) => receive_tcp(socket, &mut self.suits),
        }
    }

    /// Properties of the station's own subject that the suit reported.
    pub fn subject(&self) -> &SuitSubject {
        self.suits.own().subject()
    }

    /// Body scale of the station's own subject, as a message; `None` until the suit reported it.
    pub fn body(&self) -> Option<SuitBody> {
        self.suits.own().body()
    }

    /// Counts since the start: the station's own subject, and all datagrams of no configured character.
    pub fn counts(&self) -> &Counts {
        self.suits.own().counts()
    }

    /// The assembler of a configured character.
    pub fn assembler(&self, avatar: u8) -> Option<&SuitAssembler> {
        let (own, _) = self.health.first()?;
        if avatar == *own { Some(self.suits.own()) } else { self.suits.other(avatar) }
    }

    /// The station's own counts as a message, with the rate since the last call. Reasons in the order of
    /// [`crate::suit::SuitRefusal`].
    pub fn health(&mut self) -> AdapterHealth {
        let own = self.health.first().map_or(0, |(own, _)| *own);
        // The station's own character always exists.
        self.health_of(own).unwrap_or_else(bytemuck::Zeroable::zeroed)
    }

    /// The same of a configured character.
    pub fn health_of(&mut self, avatar: u8) -> Option<AdapterHealth> {
        let counts = *self.assembler(avatar)?.counts();
        let (_, reporter) = self.health.iter_mut().find(|(whose, _)| *whose == avatar)?;
        Some(reporter.report(&counts, now_monotonic_ns()))
    }
}

fn receive_udp(
    socket: &mut StampedUdpSocket,
    sender: &mut OneSender,
    suits: &mut SuitRouter,
) -> Result<Option<SuitSample>, SourceError> {
    for _ in 0..MAX_DATAGRAMS_PER_CALL {
        let Some(received) = socket.receive()? else {
            return Ok(None);
        };
        if !received.admitted || !sender.admits(received.sender.ip(), received.arrival_ns) {
            suits.refuse_datagram(SuitRefusal::ForeignSender);
            continue;
        }
        if let Some(sample) = suits.receive(received.bytes, received.arrival_ns) {
            sender.hold(received.sender.ip(), received.arrival_ns);
            return Ok(Some(sample));
        }
    }
    Ok(None)
}

fn receive_tcp(socket: &mut TcpSocket, suits: &mut SuitRouter) -> Result<Option<SuitSample>, SourceError> {
    for _ in 0..MAX_DATAGRAMS_PER_CALL {
        match socket.receive()? {
            None => return Ok(None),
            Some(SocketEvent::LostStep) => suits.refuse_datagram(SuitRefusal::OutOfStep),
            Some(SocketEvent::Refused(_)) => suits.refuse_datagram(SuitRefusal::ForeignSender),
            Some(SocketEvent::Datagram { bytes, arrival_ns, .. }) => {
                if let Some(sample) = suits.receive(bytes, arrival_ns) {
                    socket.accepted();
                    return Ok(Some(sample));
                }
            }
        }
    }
    Ok(None)
}
