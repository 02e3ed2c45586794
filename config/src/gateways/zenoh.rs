//! `[gateways.zenoh]`

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{Checked, between};

/// `[gateways.zenoh]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ZenohConfig {
    /// Routers or peers to connect to, as Zenoh writes them: "tcp/192.0.2.30:7447".
    #[serde(default)]
    pub connect: Vec<String>,
    /// Where to listen for peers.
    #[serde(default)]
    pub listen: Vec<String>,
    /// ROS 2 messages a second, 1 to 1000.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: f64,
    /// JSON messages for dashboards a second, at most `rate_hz`.
    #[serde(default = "default_json_rate_hz")]
    pub json_rate_hz: f64,
    /// `ROS_DOMAIN_ID` of those who subscribe by `rmw_zenoh`, 0 to 232.
    #[serde(default)]
    pub ros_domain_id: u32,
    /// The worker's mass and centre of mass too.
    #[serde(default)]
    pub body: bool,
    /// A Zenoh configuration file (JSON5) for all else, such as TLS.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
}

fn default_rate_hz() -> f64 {
    100.0
}

fn default_json_rate_hz() -> f64 {
    10.0
}

/// The largest `ROS_DOMAIN_ID`, by DDS's rule for ports.
const ROS_DOMAIN_MAX: u32 = 232;

impl ZenohConfig {
    pub(super) fn check(&self) -> Checked {
        between("gateways.zenoh.rate_hz", self.rate_hz, 1.0, 1000.0)?;
        between("gateways.zenoh.json_rate_hz", self.json_rate_hz, 0.1, self.rate_hz)?;
        if self.ros_domain_id > ROS_DOMAIN_MAX {
            let what = format!("{} is no ROS_DOMAIN_ID: 0 to {ROS_DOMAIN_MAX}", self.ros_domain_id);
            return Err(("gateways.zenoh.ros_domain_id", what));
        }
        if self.connect.is_empty() && self.listen.is_empty() && self.file.is_none() {
            let what = "no peer can be reached: name a router, as \"tcp/192.0.2.30:7447\", or an address at \
                        gateways.zenoh.listen";
            return Err(("gateways.zenoh.connect", what.to_owned()));
        }
        Ok(())
    }

    pub(super) fn paths(&mut self) -> [&mut Option<PathBuf>; 1] {
        [&mut self.file]
    }
}
