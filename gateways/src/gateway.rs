//! Interface of a gateway.

use std::fmt;

use equipoise_client::{NoReading, Reading};

/// Newest input of a gateway at a tick: a current state, or the reason why there is none.
pub type Latest = Result<Reading, NoReading>;

/// Encodes states as messages of one protocol and sends them.
pub trait Gateway {
    /// Sends the messages of one tick. They must contain the reason why there is no state as well as the values, so
    /// that receivers do not keep using the last state.
    ///
    /// Must not block: data that a peer does not accept now is dropped and counted, because the next tick supersedes
    /// it.
    fn send(&mut self, latest: &Latest);

    /// Counts of sent and lost messages so far.
    fn tally(&self) -> Tally;
}

/// Counts since the start of a gateway.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// Messages handed to the network, for all peers together.
    pub sent: u64,
    /// Messages that a peer did not accept in time, or that could not be sent.
    pub lost: u64,
    /// Number of peers now.
    pub peers: u64,
}

impl fmt::Display for Tally {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Tally { sent, lost, peers } = self;
        write!(to, "{sent} sent, {lost} lost, {peers} peers")
    }
}
