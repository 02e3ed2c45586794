//! `[gateways.foxglove]`

use std::net::SocketAddr;

use serde::{Deserialize, Serialize};

use super::{Checked, between};

/// `[gateways.foxglove]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FoxgloveConfig {
    /// Loopback address to serve at; 8765 is the usual port.
    pub listen: SocketAddr,
    /// Pictures a second, 1 to 200.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: f64,
}

fn default_rate_hz() -> f64 {
    60.0
}

impl FoxgloveConfig {
    pub(super) fn check(&self) -> Checked {
        if !self.listen.ip().is_loopback() {
            let what = "it shows a person's motion to every client that connects: use a loopback address, for \
                        example 127.0.0.1:8765, and an SSH tunnel from elsewhere";
            return Err(("gateways.foxglove.listen", what.to_owned()));
        }
        between("gateways.foxglove.rate_hz", self.rate_hz, 1.0, 200.0)
    }
}
