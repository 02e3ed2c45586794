//! A device decoder and the receiver of its readings: bytes in, samples out.

use super::device::{Action, GroundDevice};
use super::reading::Decoded;
use super::receiver::{GroundReceiver, GroundSettings};
use super::refusal::GroundRefusal;
use crate::counts::Counts;
use equipoise_core::message::GroundSample;

/// The part of a ground source that does no I/O; common to live lines, captures and tests.
pub struct GroundProtocol {
    device: Box<dyn GroundDevice>,
    receiver: GroundReceiver,
    decoded: Decoded,
}

impl core::fmt::Debug for GroundProtocol {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("GroundProtocol").field("receiver", &self.receiver).finish_non_exhaustive()
    }
}

impl GroundProtocol {
    /// Creates the state machine before any data.
    pub fn new(device: Box<dyn GroundDevice>, settings: GroundSettings) -> GroundProtocol {
        GroundProtocol { device, receiver: GroundReceiver::new(settings), decoded: Decoded::default() }
    }

    /// The connection was opened (again).
    pub fn opened(&mut self, now_ns: u64) {
        self.device.opened(now_ns);
        self.receiver.restart();
    }

    /// The connection was opened (again) at the first byte of its source.
    pub fn opened_at_start(&mut self, now_ns: u64) {
        self.device.opened_at_start(now_ns);
        self.receiver.restart();
    }

    /// Processes one datagram, or a piece of a stream, and appends its samples to `samples`, oldest first.
    pub fn receive(&mut self, bytes: &[u8], arrival_ns: u64, samples: &mut Vec<GroundSample>) {
        self.device.take(bytes, arrival_ns, &mut self.decoded);
        self.receiver.receive(&mut self.decoded, arrival_ns, samples);
    }

    /// As [`GroundDevice::next_action`].
    pub fn next_action(&mut self, now_ns: u64) -> Action {
        self.device.next_action(now_ns)
    }

    /// As [`GroundDevice::close_command`].
    pub fn close_command(&mut self) -> Option<Vec<u8>> {
        self.device.close_command()
    }

    /// As [`GroundDevice::diagnostic`].
    pub fn diagnostic(&self) -> Option<String> {
        self.device.diagnostic()
    }

    /// As [`GroundDevice::note`].
    pub fn note(&self) -> Option<String> {
        self.device.note()
    }

    /// Counts input that was refused before decoding.
    pub fn refuse(&mut self, refusal: GroundRefusal) {
        self.receiver.refuse(refusal);
    }

    /// Counts since the start; `refused` in the order of [`GroundRefusal`].
    pub fn counts(&self) -> &Counts {
        self.receiver.counts()
    }

    /// As [`GroundReceiver::block_latency_ns`].
    pub fn block_latency_ns(&self) -> u64 {
        self.receiver.block_latency_ns()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::device::bota::{Bota, BotaSettings};

    #[test]
    fn a_way_that_is_opened_again_and_again_and_brings_nothing_takes_no_room() {
        let device = Box::new(Bota::new(BotaSettings { baud: 460_800, sinc: None }));
        let mut protocol = GroundProtocol::new(device, GroundSettings::default());
        for now_ns in 0..1000 {
            protocol.opened(now_ns);
        }
        assert!(protocol.decoded.events.is_empty());
    }
}
