//! `[gateways.mqtt]`

use std::net::IpAddr;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{Checked, between, is_host};

/// `[gateways.mqtt]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MqttConfig {
    /// Host name or address of the broker; with TLS, as in its certificate.
    pub broker: String,
    /// Its port; 8883 with TLS and 1883 without, by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub port: Option<u16>,
    /// Messages a second, 0.1 to 10.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: f64,
    /// File with the certificate of the authority that signed the broker's (PEM). With it the connection is TLS.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ca_file: Option<PathBuf>,
    /// File with `name:password`, readable by its owner only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub password_file: Option<PathBuf>,
    /// This client's own certificate (PEM), if the broker asks for one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate_file: Option<PathBuf>,
    /// Its key (PEM), readable by its owner only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key_file: Option<PathBuf>,
    /// Plain TCP to another machine: every machine on the path can read and change the messages.
    #[serde(default)]
    pub insecure: bool,
    /// The whole state too, with positions and torques: how a person moves then leaves this machine.
    #[serde(default)]
    pub motion: bool,
}

fn default_rate_hz() -> f64 {
    1.0
}

impl MqttConfig {
    /// The broker's port.
    pub fn port(&self) -> u16 {
        self.port.unwrap_or(if self.ca_file.is_some() { 8883 } else { 1883 })
    }

    fn is_local(&self) -> bool {
        self.broker == "localhost" || self.broker.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
    }

    pub(super) fn check(&self) -> Checked {
        between("gateways.mqtt.rate_hz", self.rate_hz, 0.1, 10.0)?;
        let wrong = |key, what: &str| Err((key, what.to_owned()));
        if !is_host(&self.broker) {
            return wrong(
                "gateways.mqtt.broker",
                "give only its name or address: no scheme, no path; the port is a key",
            );
        }
        if self.ca_file.is_some() && self.insecure {
            return wrong(
                "gateways.mqtt.insecure",
                "with ca_file the connection is TLS: leave one of the two out",
            );
        }
        if self.ca_file.is_none() && !self.insecure && !self.is_local() {
            return wrong(
                "gateways.mqtt.ca_file",
                "the broker is another machine: name the certificate of the authority that signed its own, or set \
                 insecure = true if every machine on the path may read and change the messages",
            );
        }
        if self.certificate_file.is_some() != self.key_file.is_some() {
            return wrong("gateways.mqtt.certificate_file", "certificate_file and key_file belong together");
        }
        if self.certificate_file.is_some() && self.ca_file.is_none() {
            return wrong(
                "gateways.mqtt.certificate_file",
                "a certificate is shown over TLS only: name a ca_file too",
            );
        }
        Ok(())
    }

    pub(super) fn paths(&mut self) -> [&mut Option<PathBuf>; 4] {
        [&mut self.ca_file, &mut self.password_file, &mut self.certificate_file, &mut self.key_file]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> Option<&'static str> {
        toml::from_str::<MqttConfig>(text).unwrap().check().err().map(|(key, _)| key)
    }

    #[test]
    fn other_machines_need_tls_unless_insecure_is_set() {
        for local in ["localhost", "127.0.0.1", "::1"] {
            assert_eq!(refused(&format!("broker = \"{local}\"")), None);
        }
        let other = "broker = \"broker.plant.example\"\n";
        assert_eq!(refused(other), Some("gateways.mqtt.ca_file"));
        assert_eq!(refused(&format!("{other}insecure = true")), None);
        assert_eq!(refused(&format!("{other}ca_file = \"ca.pem\"")), None);
        assert_eq!(
            refused(&format!("{other}ca_file = \"ca.pem\"\ninsecure = true")),
            Some("gateways.mqtt.insecure")
        );
    }

    #[test]
    fn ports_follow_the_kind_of_connection() {
        let port =
            |keys: &str| toml::from_str::<MqttConfig>(&format!("broker = \"b\"\n{keys}")).unwrap().port();
        assert_eq!((port(""), port("ca_file = \"c\""), port("port = 99")), (1883, 8883, 99));
    }

    #[test]
    fn what_does_not_fit_together_is_refused() {
        let tls = "broker = \"b\"\nca_file = \"ca.pem\"\n";
        for broker in ["mqtts://b", "b:1883", "127.0.0.1:1883"] {
            assert_eq!(refused(&format!("broker = \"{broker}\"")), Some("gateways.mqtt.broker"), "{broker}");
        }
        assert_eq!(
            refused(&format!("{tls}certificate_file = \"c\"")),
            Some("gateways.mqtt.certificate_file")
        );
        assert_eq!(refused(&format!("{tls}certificate_file = \"c\"\nkey_file = \"k\"")), None);
        assert_eq!(refused(&format!("{tls}rate_hz = 11.0")), Some("gateways.mqtt.rate_hz"));
    }
}
