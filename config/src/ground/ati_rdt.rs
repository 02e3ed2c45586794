//! ATI Net F/T and Axia: keys of `[ground]` and `[ground.ati]`.

use std::net::SocketAddr;

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::ati_rdt::{AtiRdt, RdtSettings};
use equipoise_adapters::source::{NetFtLine, NetFtLineSettings, Transport, UdpLine};
use equipoise_adapters::wire::ati_rdt::{Command, DEFAULT_PORT};
use serde::{Deserialize, Serialize};

use super::GroundConfig;
use crate::method::{Checked, between};

/// `[ground.ati]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AtiConfig {
    /// Device family, which determines the start request.
    pub model: Model,
    /// Whether the device's settings page is read and compared with the configuration.
    pub page: bool,
    /// The port of the device's web pages.
    pub page_port: u16,
}

impl Default for AtiConfig {
    fn default() -> Self {
        AtiConfig { model: Model::default(), page: true, page_port: 80 }
    }
}

/// Device families.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Net F/T boxes.
    #[default]
    NetFt,
    /// Axia sensors with Ethernet.
    Axia,
}

fn section(ground: &GroundConfig) -> AtiConfig {
    ground.ati.clone().unwrap_or_default()
}

/// The device's address; by default the standard port on this PC.
pub fn address(ground: &GroundConfig) -> SocketAddr {
    ground.address.unwrap_or(SocketAddr::from(([127, 0, 0, 1], DEFAULT_PORT)))
}

/// The decoder of its records.
pub fn device(ground: &GroundConfig) -> Box<dyn GroundDevice> {
    Box::new(AtiRdt::new(RdtSettings {
        counts_per_newton: ground.counts_per_newton,
        counts_per_newton_metre: ground.counts_per_newton_metre,
        start: match section(ground).model {
            Model::NetFt => Command::StartRealTime,
            Model::Axia => Command::StartSingleBlock,
        },
    }))
}

pub(super) fn transport(ground: &GroundConfig) -> Box<dyn Transport> {
    let (config, address) = (section(ground), address(ground));
    if !config.page {
        return Box::new(UdpLine::to(address, "ground.address"));
    }
    let page_needed = !are_counts_given(ground);
    let settings = NetFtLineSettings { address, page_port: config.page_port, page_needed };
    Box::new(NetFtLine::new(settings, "ground.address"))
}

/// Whether the scale is configured, so that the device can be read without its settings page, as in a capture.
pub fn are_counts_given(ground: &GroundConfig) -> bool {
    ground.counts_per_newton.is_some() && ground.counts_per_newton_metre.is_some()
}

/// Counts per N or N m. Below, one count exceeds a newton; above, the 32 bits of a reading end at 2.1 N.
const COUNTS_MIN: f64 = 1.0;
const COUNTS_MAX: f64 = 1e9;

pub(super) fn check(ground: &GroundConfig) -> Checked {
    for (field, counts) in [
        ("ground.counts_per_newton", ground.counts_per_newton),
        ("ground.counts_per_newton_metre", ground.counts_per_newton_metre),
    ] {
        match counts {
            None if section(ground).page => {}
            None => {
                let what = "must be given for an ATI device whose page netftapi2.xml is not read; it stands there as cfgcpf \
                            and cfgcpt";
                return Err((field, what.to_owned()));
            }
            Some(counts) => between(field, counts, COUNTS_MIN, COUNTS_MAX)?,
        }
    }
    Ok(())
}
