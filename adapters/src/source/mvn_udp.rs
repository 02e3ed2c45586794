//! The suit over UDP: MVN's Network Streamer sends, we listen.

use super::udp::{Senders, SourceError, UdpDoor};
use crate::clock::now_monotonic_ns;
use crate::counts::{Counts, HealthReporter, Stream};
use crate::suit::{SuitAssembler, SuitRefusal, SuitSettings, SuitSubject};
use equipoise_core::message::{AdapterHealth, SuitSample};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

/// A second sender is listened to once the first has been silent for so long.
const SENDER_HOLDS_NS: u64 = 1_000_000_000;
/// One call reads at most so many datagrams, so that a flood of refused ones does not hold up its caller.
const MAX_DATAGRAMS_PER_CALL: usize = 64;

/// Where to listen, and for what.
#[derive(Debug, Clone, Copy)]
pub struct MvnUdpSettings {
    /// The address to listen on.
    pub listen: SocketAddr,
    /// Whether computers other than this one may send.
    pub allow_remote: bool,
    /// How long one [`MvnUdpSource::receive`] waits.
    pub timeout: Duration,
    /// What to make of the datagrams.
    pub suit: SuitSettings,
}

impl Default for MvnUdpSettings {
    fn default() -> Self {
        MvnUdpSettings {
            listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), crate::wire::mvn::DEFAULT_PORT),
            allow_remote: false,
            timeout: Duration::from_millis(100),
            suit: SuitSettings::default(),
        }
    }
}

/// A suit that streams to us.
#[derive(Debug)]
pub struct MvnUdpSource {
    door: UdpDoor,
    assembler: SuitAssembler,
    health: HealthReporter,
    /// Who sends, and when last. Two suits on one port would tear each other's samples apart.
    sender: Option<(IpAddr, u64)>,
}

impl MvnUdpSource {
    /// Begins to listen.
    ///
    /// # Errors
    /// [`SourceError::PortTaken`] or [`SourceError::Open`].
    pub fn open(settings: MvnUdpSettings) -> Result<MvnUdpSource, SourceError> {
        let senders = if settings.allow_remote { Senders::Anyone } else { Senders::Loopback };
        Ok(MvnUdpSource {
            door: UdpDoor::open(settings.listen, senders, settings.timeout, "suit.listen")?,
            assembler: SuitAssembler::new(settings.suit),
            health: HealthReporter::new(Stream::Suit, now_monotonic_ns()),
            sender: None,
        })
    }

    /// The address it listens on.
    pub fn local_address(&self) -> SocketAddr {
        self.door.local_address()
    }

    /// Waits for one sample; `None` after the timeout, or if what came made no sample.
    ///
    /// # Errors
    /// [`SourceError::Receive`] if the socket itself fails.
    pub fn receive(&mut self) -> Result<Option<SuitSample>, SourceError> {
        if let Some(sample) = self.assembler.take_ready() {
            return Ok(Some(sample));
        }
        for _ in 0..MAX_DATAGRAMS_PER_CALL {
            let Some(received) = self.door.receive()? else {
                return Ok(None);
            };
            let sender = received.sender.ip();
            let held = self.sender.is_some_and(|(holder, last_ns)| {
                holder != sender && received.arrival_ns.saturating_sub(last_ns) < SENDER_HOLDS_NS
            });
            if held || !received.admitted {
                self.assembler.refuse_datagram(SuitRefusal::ForeignSender);
                continue;
            }
            self.sender = Some((sender, received.arrival_ns));
            if let Some(sample) = self.assembler.receive(received.bytes, received.arrival_ns) {
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }

    /// What the suit said about its wearer.
    pub fn subject(&self) -> &SuitSubject {
        self.assembler.subject()
    }

    /// What was counted since the start.
    pub fn counts(&self) -> &Counts {
        self.assembler.counts()
    }

    /// The counts as a message, with the rate since the last call. Reasons in the order of [`SuitRefusal`].
    pub fn health(&mut self) -> AdapterHealth {
        self.health.report(self.assembler.counts(), now_monotonic_ns())
    }
}
