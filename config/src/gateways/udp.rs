//! `[gateways.udp]`

use std::net::{IpAddr, SocketAddr};

use serde::{Deserialize, Serialize};

use super::{Checked, between};

/// `[gateways.udp]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UdpConfig {
    /// Addresses of the receivers.
    pub to: Vec<SocketAddr>,
    /// Datagrams a second, 50 to 1000.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: f64,
}

fn default_rate_hz() -> f64 {
    500.0
}

impl UdpConfig {
    pub(super) fn check(&self) -> Checked {
        if self.to.is_empty() {
            return Err(("gateways.udp.to", "name at least one address, as \"192.0.2.17:7411\"".to_owned()));
        }
        for (index, address) in self.to.iter().enumerate() {
            let is_broadcast = matches!(address.ip(), IpAddr::V4(ip) if ip.is_broadcast());
            if address.port() == 0 || address.ip().is_unspecified() || is_broadcast {
                let what = format!(
                    "{address} is not a unicast address with a non-zero port; set the receiver's address and port"
                );
                return Err(("gateways.udp.to", what));
            }
            if self.to[..index].contains(address) {
                let what = format!(
                    "{address} is listed twice; the receiver would report a second sender. Remove the duplicate."
                );
                return Err(("gateways.udp.to", what));
            }
        }
        between("gateways.udp.rate_hz", self.rate_hz, 50.0, 1000.0)
    }
}
