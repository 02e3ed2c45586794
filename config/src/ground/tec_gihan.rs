//! `[ground.tec_gihan]`: plates of Tec Gihan.

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::tec_gihan::{TecGihan, TecGihanSettings};
use equipoise_adapters::source::{Flow, SourceError, Transport};
use equipoise_adapters::wire::tec_gihan::{self as wire, BAUD, PLATES_MAX, Rate};
use serde::{Deserialize, Serialize};

use super::{GroundConfig, serial, z_down};
use crate::method::{Checked, between};

/// `[ground.tec_gihan]`; optional.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TecGihanConfig {
    /// Number of the plate at the controller, from 1.
    pub plate: u32,
    /// Sampling rate, Hz: 10000, 5000, 2500, 1000, 500, 250, 240 or 120. Blocks contain 100 samples (24 at 240 Hz, 12
    /// at 120 Hz).
    pub rate_hz: u32,
    /// Vertical full scale.
    pub range: Range,
}

/// Vertical full scale of the plates' amplifiers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Range {
    /// 3 kN.
    #[serde(rename = "3kN")]
    Kn3,
    /// 6 kN.
    #[serde(rename = "6kN")]
    Kn6,
    /// 10 kN.
    #[serde(rename = "10kN")]
    Kn10,
}

impl Default for TecGihanConfig {
    fn default() -> Self {
        // A high rate has short blocks: 40 ms.
        TecGihanConfig { plate: 1, rate_hz: 2500, range: Range::Kn3 }
    }
}

const DEFAULTS: serial::SerialDefaults = serial::SerialDefaults { baud: BAUD, flow: Flow::RtsCts };

fn rate(config: &TecGihanConfig) -> Result<Rate, String> {
    Rate::of_hz(config.rate_hz).ok_or_else(|| {
        let rates = Rate::ALL.map(|rate| rate.hz.to_string()).join(", ");
        format!("{} is none of {rates}", config.rate_hz)
    })
}

/// Duration of a block, ns.
pub(super) fn block_ns(ground: &GroundConfig) -> u64 {
    rate(&ground.tec_gihan.clone().unwrap_or_default()).map_or(0, Rate::block_ns)
}

pub(super) fn rate_hz(ground: &GroundConfig) -> f64 {
    f64::from(ground.tec_gihan.clone().unwrap_or_default().rate_hz)
}

pub(super) fn device(ground: &GroundConfig) -> Result<Box<dyn GroundDevice>, SourceError> {
    let config = ground.tec_gihan.clone().unwrap_or_default();
    let wrong = |what| SourceError::Unusable(format!("ground.tec_gihan.rate_hz: {what}"));
    Ok(Box::new(TecGihan::new(TecGihanSettings {
        plate: config.plate,
        rate: rate(&config).map_err(wrong)?,
        range: match config.range {
            Range::Kn3 => wire::Range::Kn3,
            Range::Kn6 => wire::Range::Kn6,
            Range::Kn10 => wire::Range::Kn10,
        },
        surface_height_m: ground.frame.surface_height_m,
    })))
}

pub(super) fn transport(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    serial::line(ground, DEFAULTS)
}

pub(super) fn check(ground: &GroundConfig) -> Checked {
    serial::check(ground)?;
    let config = ground.tec_gihan.clone().unwrap_or_default();
    between("ground.tec_gihan.plate", f64::from(config.plate), 1.0, f64::from(PLATES_MAX))?;
    rate(&config).map_err(|what| ("ground.tec_gihan.rate_hz", what))?;
    z_down::check(ground, "Tec Gihan's plates")
}
