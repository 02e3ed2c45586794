//! The suit over UDP: MVN's Network Streamer sends, we listen.

use super::error::SourceError;
use super::mvn::{MAX_DATAGRAMS_PER_CALL, MvnSettings};
use super::udp::UdpDoor;
use crate::suit::{SuitRefusal, SuitRouter};
use equipoise_core::message::SuitSample;
use std::net::IpAddr;

/// A second sender is listened to once the first has been silent for so long.
const SENDER_HOLDS_NS: u64 = 1_000_000_000;

/// Suits that stream to us from one computer.
#[derive(Debug)]
pub(super) struct MvnUdpSource {
    pub(super) door: UdpDoor,
    /// Who sends, and when last. Two computers on one port would tear each other's samples apart.
    sender: Option<(IpAddr, u64)>,
}

impl MvnUdpSource {
    pub(super) fn open(settings: &MvnSettings) -> Result<MvnUdpSource, SourceError> {
        let door = UdpDoor::open(settings.listen, settings.senders(), settings.timeout, "suit.listen")?;
        Ok(MvnUdpSource { door, sender: None })
    }

    pub(super) fn receive(&mut self, suits: &mut SuitRouter) -> Result<Option<SuitSample>, SourceError> {
        for _ in 0..MAX_DATAGRAMS_PER_CALL {
            let Some(received) = self.door.receive()? else {
                return Ok(None);
            };
            let sender = received.sender.ip();
            let held = self.sender.is_some_and(|(holder, last_ns)| {
                holder != sender && received.arrival_ns.saturating_sub(last_ns) < SENDER_HOLDS_NS
            });
            if held || !received.admitted {
                suits.refuse_datagram(SuitRefusal::ForeignSender);
                continue;
            }
            self.sender = Some((sender, received.arrival_ns));
            if let Some(sample) = suits.receive(received.bytes, received.arrival_ns) {
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }
}
