//! The suit over TCP: MVN's Network Streamer connects to this machine.

use super::error::SourceError;
use super::mvn::{MAX_DATAGRAMS_PER_CALL, MvnSettings};
use super::tcp_door::{Heard, TcpDoor};
use crate::suit::{SuitRefusal, SuitRouter};
use equipoise_core::message::SuitSample;

/// A suit that streams to this machine; one at a time.
#[derive(Debug)]
pub(super) struct MvnTcpSource {
    pub(super) door: TcpDoor,
}

impl MvnTcpSource {
    pub(super) fn open(settings: &MvnSettings) -> Result<MvnTcpSource, SourceError> {
        let door = TcpDoor::open(settings.listen, settings.senders(), settings.timeout, "suit.listen")?;
        Ok(MvnTcpSource { door })
    }

    pub(super) fn receive(&mut self, suits: &mut SuitRouter) -> Result<Option<SuitSample>, SourceError> {
        for _ in 0..MAX_DATAGRAMS_PER_CALL {
            match self.door.receive()? {
                None => return Ok(None),
                Some(Heard::LostStep) => suits.refuse_datagram(SuitRefusal::OutOfStep),
                Some(Heard::TurnedAway(_)) => suits.refuse_datagram(SuitRefusal::ForeignSender),
                Some(Heard::Datagram { bytes, arrival_ns, .. }) => {
                    if let Some(sample) = suits.receive(bytes, arrival_ns) {
                        self.door.accepted();
                        return Ok(Some(sample));
                    }
                }
            }
        }
        Ok(None)
    }
}
