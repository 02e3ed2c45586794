//! Why a source does not work, in words for whoever set it up.

use std::io;
use std::net::SocketAddr;

/// Why a source does not work.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The port is in use.
    #[error(
        "port {port} is taken: another program (another Equipoise, MVN itself, a viewer) listens on {address}; \
             close it or set {key}"
    )]
    PortTaken {
        /// The port asked for.
        port: u16,
        /// The whole address asked for.
        address: SocketAddr,
        /// The configuration key that chooses it.
        key: &'static str,
    },
    /// The socket could not be opened for another reason.
    #[error("cannot listen on {address}: {error}; is {key} an address of this computer?")]
    Open {
        /// The address asked for.
        address: SocketAddr,
        /// The configuration key that chooses it.
        key: &'static str,
        /// What the system says.
        #[source]
        error: io::Error,
    },
    /// Receiving failed for another reason than silence.
    #[error("cannot receive on {address}: {error}")]
    Receive {
        /// The local address.
        address: SocketAddr,
        /// What the system says.
        #[source]
        error: io::Error,
    },
    /// A request could not be sent.
    #[error("cannot send to {address}: {error}; check the cable and {key}")]
    Send {
        /// The device.
        address: SocketAddr,
        /// The configuration key that chooses it.
        key: &'static str,
        /// What the system says.
        #[source]
        error: io::Error,
    },
    /// The device is not there now; it may come (back).
    #[error("{what} is not there: {error}; {remedy}")]
    Absent {
        /// Which device or line, as people call it.
        what: String,
        /// What to look at, and which key names it.
        remedy: String,
        /// What the system or the device says.
        #[source]
        error: io::Error,
    },
    /// What leads to the device is there and cannot be used now; somebody may change that while we run.
    #[error("{what} cannot be used: {why}; {remedy}")]
    Unready {
        /// Which device or line, as people call it.
        what: String,
        /// What stands in the way.
        why: String,
        /// What to do.
        remedy: String,
    },
    /// The device, or what leads to it, is set up in a way that cannot work; only a person can mend that.
    #[error("{0}")]
    Unusable(String),
}

impl SourceError {
    /// Whether trying again later may help without anybody changing the configuration.
    pub fn may_mend(&self) -> bool {
        matches!(self, SourceError::Absent { .. } | SourceError::Unready { .. } | SourceError::Send { .. })
    }
}
