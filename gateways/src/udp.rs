//! `[gateways.udp]`: datagrams of fixed layout ([`layout`]) to configured addresses; docs/consumers/udp.md has the
//! table.
//!
//! A datagram is sent at every tick, with a state or with the reason why there is none; if none arrives, the network or
//! this program has failed. No receiver can block it: sockets are non-blocking, and datagrams that cannot be sent are
//! counted.

pub mod encode;
pub mod layout;
mod peer;

use std::net::SocketAddr;
use std::time::{SystemTime, UNIX_EPOCH};

use crate::config::StationFile;
use crate::gateway::{Gateway, Latest, Tally};
use crate::process::{ScheduledGateway, no_section};
use encode::{Datagram, encode};
use peer::Peer;

/// Sends datagrams to all configured addresses.
#[derive(Debug)]
pub struct Udp {
    station: String,
    session_ns: u64,
    sequence: u64,
    /// From the last state; still sent while there is none.
    daemon_life: u16,
    peers: Vec<Peer>,
}

impl Udp {
    /// A gateway of `station` to these addresses. The session is the wall-clock time of the start, so that a receiver
    /// distinguishes a later start from an earlier one.
    pub fn new(station: &str, to: &[SocketAddr]) -> Udp {
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let session_ns = since_epoch.as_nanos() as u64;
        let peers = to.iter().copied().map(Peer::new).collect();
        Udp { station: station.to_owned(), session_ns, sequence: 0, daemon_life: 0, peers }
    }
}

impl Gateway for Udp {
    fn send(&mut self, latest: &Latest) {
        self.sequence += 1;
        if let Ok(reading) = latest {
            // The count may wrap around; consecutive starts still differ.
            self.daemon_life = reading.daemon_life as u16;
        }
        let Udp { station, session_ns, sequence, daemon_life, .. } = self;
        let datagram = Datagram::new(station, *session_ns, *sequence, *daemon_life, latest);
        let bytes = encode(&datagram);
        for peer in &mut self.peers {
            peer.send(&bytes);
        }
    }

    fn tally(&self) -> Tally {
        Tally {
            sent: self.peers.iter().map(|peer| peer.sent).sum(),
            lost: self.peers.iter().map(|peer| peer.lost).sum(),
            peers: self.peers.iter().filter(|peer| peer.takes()).count() as u64,
        }
    }
}

/// Creates the gateway from the configuration.
///
/// # Errors
/// There is no `[gateways.udp]`.
pub fn create(file: &StationFile) -> anyhow::Result<ScheduledGateway> {
    let config = file.gateways.udp.as_ref().ok_or_else(|| no_section("udp"))?;
    Ok(ScheduledGateway { gateway: Box::new(Udp::new(&file.station, &config.to)), rate_hz: config.rate_hz })
}
