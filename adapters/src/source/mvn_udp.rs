//! The suit over UDP: MVN's Network Streamer sends, this machine listens.

use super::error::SourceError;
use super::mvn::{MAX_DATAGRAMS_PER_CALL, MvnSettings};
use super::udp::{OneSender, UdpDoor};
use crate::suit::{SuitRefusal, SuitRouter};
use equipoise_core::message::SuitSample;

/// Suits that stream from one computer.
#[derive(Debug)]
pub(super) struct MvnUdpSource {
    pub(super) door: UdpDoor,
    sender: OneSender,
}

impl MvnUdpSource {
    pub(super) fn open(settings: &MvnSettings) -> Result<MvnUdpSource, SourceError> {
        let door = UdpDoor::open(settings.listen, settings.senders(), settings.timeout, "suit.listen")?;
        Ok(MvnUdpSource { door, sender: OneSender::default() })
    }

    pub(super) fn receive(&mut self, suits: &mut SuitRouter) -> Result<Option<SuitSample>, SourceError> {
        for _ in 0..MAX_DATAGRAMS_PER_CALL {
            let Some(received) = self.door.receive()? else {
                return Ok(None);
            };
            if !received.admitted || !self.sender.admits(received.sender.ip(), received.arrival_ns) {
                suits.refuse_datagram(SuitRefusal::ForeignSender);
                continue;
            }
            if let Some(sample) = suits.receive(received.bytes, received.arrival_ns) {
                self.sender.hold(received.sender.ip(), received.arrival_ns);
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }
}
