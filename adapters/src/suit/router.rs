//! Routes several characters on one port, each to its own assembler.
//!
//! MVN sends all characters, and tracked objects, to one address; only the avatar id in the header distinguishes them.

use super::assembler::SuitAssembler;
use super::refusal::SuitRefusal;
use super::settings::SuitSettings;
use crate::wire::mvn::Header;
use equipoise_core::message::SuitSample;

/// The assemblers of all configured characters.
#[derive(Debug, Clone)]
pub struct SuitRouter {
    /// The station's own subject: also receives, and counts, datagrams of no configured character.
    own: SuitAssembler,
    others: Vec<(u8, SuitAssembler)>,
}

impl SuitRouter {
    /// For the character of `settings`, and for others with the same settings except the character.
    pub fn new(settings: SuitSettings, others: &[u8]) -> SuitRouter {
        let wanted = others.iter().filter(|avatar| **avatar != settings.avatar);
        let assembler =
            |avatar: &u8| (*avatar, SuitAssembler::new(SuitSettings { avatar: *avatar, ..settings }));
        SuitRouter { own: SuitAssembler::new(settings), others: wanted.map(assembler).collect() }
    }

    /// As [`SuitAssembler::receive`]; the sample's `avatar` identifies the character.
    pub fn receive(&mut self, datagram: &[u8], arrival_ns: u64) -> Option<SuitSample> {
        let avatar = Header::parse(datagram).map(|header| header.avatar).ok();
        let other = self.others.iter_mut().find(|(other, _)| Some(*other) == avatar);
        other.map_or(&mut self.own, |(_, assembler)| assembler).receive(datagram, arrival_ns)
    }

    /// A sample of any character that is complete but was not returned yet.
    pub fn take_ready(&mut self) -> Option<SuitSample> {
        let others = self.others.iter_mut().map(|(_, assembler)| assembler);
        core::iter::once(&mut self.own).chain(others).find_map(SuitAssembler::take_ready)
    }

    /// Counts input that was refused before decoding; its character is unknown.
    pub fn refuse_datagram(&mut self, refusal: SuitRefusal) {
        self.own.refuse_datagram(refusal);
    }

    /// The station's own subject.
    pub fn own(&self) -> &SuitAssembler {
        &self.own
    }

    /// Another character, if configured.
    pub fn other(&self, avatar: u8) -> Option<&SuitAssembler> {
        self.others.iter().find(|(other, _)| *other == avatar).map(|(_, assembler)| assembler)
    }
}
