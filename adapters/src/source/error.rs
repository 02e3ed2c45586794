//! Why a source does not work, with texts for the operator.

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
        /// The requested port.
        port: u16,
        /// The requested address with port.
        address: SocketAddr,
        /// The configuration key that chooses it.
        key: &'static str,
    },
    /// The socket could not be opened for another reason.
    #[error("cannot listen on {address}: {error}; is {key} an address of this computer?")]
    Open {
        /// The requested address.
        address: SocketAddr,
        /// The configuration key that chooses it.
        key: &'static str,
        /// The system's error.
        #[source]
        error: io::Error,
    },
    /// Receiving failed for a reason other than a timeout.
    #[error("cannot receive on {address}: {error}")]
    Receive {
        /// The local address.
        address: SocketAddr,
        /// The system's error.
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
        /// The system's error.
        #[source]
        error: io::Error,
    },
    /// The device is absent now; it may appear later.
    #[error("{what} is not there: {error}; {remedy}")]
    Absent {
        /// Name of the device or line for the operator.
        what: String,
        /// What to check, and the configuration key.
        remedy: String,
        /// The error of the system or the device.
        #[source]
        error: io::Error,
    },
    /// The connection exists but cannot be used now; the condition may be corrected without a restart.
    #[error("{what} cannot be used: {why}; {remedy}")]
    Unready {
        /// Name of the device or line for the operator.
        what: String,
        /// The condition that prevents its use.
        why: String,
        /// The remedy.
        remedy: String,
    },
    /// The device, or the connection, is set up in a way that cannot work; this requires intervention.
    #[error("{0}")]
    Unusable(String),
}

impl SourceError {
    /// Whether a later attempt may succeed without a change of the configuration.
    pub fn may_recover(&self) -> bool {
        matches!(self, SourceError::Absent { .. } | SourceError::Unready { .. } | SourceError::Send { .. })
    }
}
