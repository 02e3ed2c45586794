//! `[gateways.opcua]`

use std::net::SocketAddr;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{Checked, between, is_host};

/// `[gateways.opcua]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpcUaConfig {
    /// Address to serve at; 4840 is the usual port.
    pub listen: SocketAddr,
    /// Name or address by which clients reach this machine, if it is not that of `listen`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub host: Option<String>,
    /// Values are renewed so often, 1 to 100 Hz.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: f64,
    /// Folder of certificates; made when it is not there. `opcua` in the state directory if not named.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pki: Option<PathBuf>,
    /// File with `name:password`, one per line, readable by its owner only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub users_file: Option<PathBuf>,
    /// Whether anonymous clients may read; by default only if the server listens on loopback.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anonymous: Option<bool>,
    /// Sessions at once, 1 to 100.
    #[serde(default = "default_sessions_max")]
    pub sessions_max: usize,
}

fn default_rate_hz() -> f64 {
    20.0
}

fn default_sessions_max() -> usize {
    10
}

impl OpcUaConfig {
    /// Whether only programs of this machine can reach it.
    pub fn is_local(&self) -> bool {
        self.listen.ip().is_loopback()
    }

    /// Whether clients without a user name may read.
    pub fn lets_anonymous_read(&self) -> bool {
        self.anonymous.unwrap_or_else(|| self.is_local())
    }

    pub(super) fn check(&self) -> Checked {
        between("gateways.opcua.rate_hz", self.rate_hz, 1.0, 100.0)?;
        between("gateways.opcua.sessions_max", self.sessions_max as f64, 1.0, 100.0)?;
        if self.users_file.is_none() && !self.lets_anonymous_read() {
            let what = "other machines can reach this address, but no client may read: name a file with name:password in \
                        gateways.opcua.users_file, or set anonymous = true if every client with a trusted certificate may \
                        read without a name; on 127.0.0.1 neither is needed";
            return Err(("gateways.opcua.listen", what.to_owned()));
        }
        let Some(host) = &self.host else {
            if self.listen.ip().is_unspecified() {
                let what = "the server announces the address to connect to, and 0.0.0.0 or [::] is none: set the name or \
                            address of this machine, as host = \"station-1.plant.example\"";
                return Err(("gateways.opcua.host", what.to_owned()));
            }
            return Ok(());
        };
        if !is_host(host) {
            let what = format!("{host:?} is neither a name nor an address: no scheme, no port, no path");
            return Err(("gateways.opcua.host", what));
        }
        Ok(())
    }

    pub(super) fn paths(&mut self) -> [&mut Option<PathBuf>; 2] {
        [&mut self.pki, &mut self.users_file]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> Option<String> {
        let config: OpcUaConfig = toml::from_str(text).unwrap();
        config.check().err().map(|(key, what)| format!("{key}: {what}"))
    }

    #[test]
    fn loopback_needs_nothing_and_the_plant_needs_users() {
        assert_eq!(refused("listen = \"127.0.0.1:4840\""), None);
        assert!(refused("listen = \"192.0.2.7:4840\"").is_some_and(|what| what.contains("users_file")));
        assert!(refused("listen = \"127.0.0.1:4840\"\nanonymous = false").is_some());
        assert_eq!(refused("listen = \"192.0.2.7:4840\"\nusers_file = \"users\""), None);
        assert_eq!(refused("listen = \"192.0.2.7:4840\"\nanonymous = true"), None);
    }

    #[test]
    fn an_unspecified_address_requires_a_host() {
        let users = "users_file = \"users\"\nlisten = \"0.0.0.0:4840\"\n";
        assert!(refused(users).is_some_and(|what| what.starts_with("gateways.opcua.host")));
        assert_eq!(refused(&format!("{users}host = \"station-1.plant.example\"")), None);
        assert_eq!(refused(&format!("{users}host = \"station_1.plant.example\"")), None, "as of a broker");
        assert!(refused(&format!("{users}host = \"opc.tcp://x/\"")).is_some());
        assert!(refused(&format!("{users}host = \"station-1:4840\"")).is_some());
        assert_eq!(refused(&format!("{users}host = \"2001:db8::7\"")), None);
    }

    #[test]
    fn rates_and_sessions_have_bounds() {
        for line in ["rate_hz = 0.5", "rate_hz = 101.0", "sessions_max = 0", "sessions_max = 101"] {
            assert!(refused(&format!("listen = \"127.0.0.1:4840\"\n{line}")).is_some(), "{line}");
        }
    }
}
