//! What an outlet is.

use std::fmt;

use equipoise_client::{NoReading, Reading};

/// What the station knows at a beat: a current state, or the reason why there is none.
pub type Seen = Result<Reading, NoReading>;

/// Turns what the station knows into messages of one wire.
pub trait Outlet {
    /// One beat. The wire must carry the reason as well as the values: who receives it must not go on with the last.
    ///
    /// It returns soon: what a peer does not take now is dropped and counted, since the next beat says more.
    fn tell(&mut self, seen: &Seen);

    /// What was told and lost so far.
    fn tally(&self) -> Tally;
}

/// What an outlet has done since its start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// Messages handed to the network, to all peers together.
    pub sent: u64,
    /// Messages that a peer did not take in time, or that could not be sent.
    pub lost: u64,
    /// Peers now.
    pub peers: u64,
}

impl fmt::Display for Tally {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Tally { sent, lost, peers } = self;
        write!(to, "{sent} sent, {lost} lost, {peers} peers")
    }
}
