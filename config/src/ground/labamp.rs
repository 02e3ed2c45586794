//! `[ground.labamp]`: Kistler's LabAmp.

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::labamp::{LabAmp, LabAmpSettings};
use equipoise_adapters::ground::plan::Plan;
use equipoise_adapters::source::{LabAmpLine, LabAmpLineSettings, SourceError, Transport};
use equipoise_adapters::wire::labamp::talk::{RATES_HZ, least_scans_per_frame};
use serde::{Deserialize, Serialize};

use super::{GroundConfig, z_down};
use crate::method::{Checked, between};

/// `[ground.labamp]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabAmpConfig {
    /// Sampling rate of the device, Hz. High rates have short blocks.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: u32,
    /// Scans per frame; by default the device's minimum at its rate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scans_per_frame: Option<u32>,
    /// Number of scans averaged to one sample; by default for about 1000 samples per second.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decimate: Option<u32>,
    /// The eight channels of a Kistler plate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eight: Option<EightConfig>,
    /// Channels of forces and moments.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direct: Option<DirectConfig>,
}

/// `[ground.labamp.eight]`: names of channels, positions of the plate's sensors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the names of Kistler's eight outputs say it")]
pub struct EightConfig {
    pub fx12: String,
    pub fx34: String,
    pub fy14: String,
    pub fy23: String,
    pub fz1: String,
    pub fz2: String,
    pub fz3: String,
    pub fz4: String,
    /// Distance of the sensors from the plate's middle along x, m.
    pub a_m: f64,
    /// Distance along y, m.
    pub b_m: f64,
}

/// `[ground.labamp.direct]` and `[ground.lsl.channels]`: names of channels.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the components of a wrench")]
pub struct DirectConfig {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fx: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fy: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fz: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mx: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub my: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mz: Option<String>,
}

/// A frame contains 8 ms at 62.5 kHz and 100 ms at 1 kHz.
fn default_rate_hz() -> u32 {
    62_500
}

/// Maximum frame duration that is useful for balance, s.
const FRAME_MAX_S: f64 = 0.5;
/// Minimum sampling rate for motion, Hz.
const LEAST_HZ: f64 = 50.0;
/// Maximum sampling rate that the daemon can use, Hz.
const MOST_HZ: f64 = 5000.0;

const NO_ADDRESS: &str = "must be given for Kistler's LabAmp: its address and port 80";
const NO_SECTION: &str =
    "must be given for Kistler's LabAmp, with either [ground.labamp.eight] or [ground.labamp.direct]";

impl EightConfig {
    /// The channels in the order of [`Plan::Eight`].
    fn names(&self) -> [&String; 8] {
        [&self.fx12, &self.fx34, &self.fy14, &self.fy23, &self.fz1, &self.fz2, &self.fz3, &self.fz4]
    }
}

/// Checks that no channel is named twice: one reading would count as two components.
fn check_distinct<'a>(key: &'static str, names: impl IntoIterator<Item = &'a String>) -> Checked {
    let mut before: Vec<&String> = Vec::new();
    for name in names {
        if before.iter().any(|other| other.eq_ignore_ascii_case(name)) {
            let what =
                format!("channel {name:?} is named twice, and each component has a channel of its own");
            return Err((key, what));
        }
        before.push(name);
    }
    Ok(())
}

impl LabAmpConfig {
    fn plan(&self) -> Result<Plan, (&'static str, String)> {
        match (&self.eight, &self.direct) {
            (Some(eight), None) => {
                Ok(Plan::Eight { names: eight.names().map(Clone::clone), a_m: eight.a_m, b_m: eight.b_m })
            }
            (None, Some(direct)) => Ok(Plan::Direct { force: direct.force(), moment: direct.moment() }),
            _ => Err(("ground.labamp", NO_SECTION.to_owned())),
        }
    }

    fn check_rates(&self) -> Checked {
        if !RATES_HZ.contains(&self.rate_hz) {
            let rates = RATES_HZ.map(|hz| hz.to_string()).join(", ");
            return Err(("ground.labamp.rate_hz", format!("{} is none of {rates}", self.rate_hz)));
        }
        let rate_hz = f64::from(self.rate_hz);
        if let Some(scans) = self.scans_per_frame {
            let least = f64::from(least_scans_per_frame(self.rate_hz));
            let most = (rate_hz * FRAME_MAX_S).max(least);
            between("ground.labamp.scans_per_frame", f64::from(scans), least, most)?;
        }
        if let Some(decimate) = self.decimate {
            let least = (rate_hz / MOST_HZ).ceil().max(1.0);
            let most = (rate_hz / LEAST_HZ).floor().max(1.0);
            between("ground.labamp.decimate", f64::from(decimate), least, most)?;
        }
        Ok(())
    }
}

fn section(ground: &GroundConfig) -> Result<&LabAmpConfig, SourceError> {
    ground.labamp.as_ref().ok_or_else(|| SourceError::Unusable(format!("ground.labamp: {NO_SECTION}")))
}

/// Duration of a frame, ns.
pub(super) fn block_ns(ground: &GroundConfig) -> u64 {
    let Some(config) = &ground.labamp else { return 0 };
    let scans = config.scans_per_frame.unwrap_or_else(|| least_scans_per_frame(config.rate_hz));
    (f64::from(scans) / f64::from(config.rate_hz.max(1)) * 1e9) as u64
}

/// Rate of samples after averaging, Hz; `None` if the device determines it.
pub(super) fn samples_hz(ground: &GroundConfig) -> Option<f64> {
    let config = ground.labamp.as_ref()?;
    Some(f64::from(config.rate_hz) / f64::from(config.decimate?.max(1)))
}

pub(super) fn device(ground: &GroundConfig) -> Result<Box<dyn GroundDevice>, SourceError> {
    let config = section(ground)?;
    let plan = config.plan().map_err(|(key, what)| SourceError::Unusable(format!("{key}: {what}")))?;
    Ok(Box::new(LabAmp::new(LabAmpSettings { plan, decimate: config.decimate })))
}

pub(super) fn transport(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    let config = section(ground)?;
    let Some(address) = ground.address else {
        return Err(SourceError::Unusable(format!("ground.address: {NO_ADDRESS}")));
    };
    Ok(Box::new(LabAmpLine::new(LabAmpLineSettings {
        address,
        rate_hz: Some(config.rate_hz),
        scans_per_frame: config.scans_per_frame,
    })))
}

pub(super) fn check(ground: &GroundConfig) -> Checked {
    if ground.address.is_none() {
        return Err(("ground.address", NO_ADDRESS.to_owned()));
    }
    let Some(config) = &ground.labamp else { return Err(("ground.labamp", NO_SECTION.to_owned())) };
    config.plan()?;
    config.check_rates()?;
    if let Some(eight) = &config.eight {
        z_down::check_kistler(ground)?;
        between("ground.labamp.eight.a_m", eight.a_m, 0.01, 2.0)?;
        between("ground.labamp.eight.b_m", eight.b_m, 0.01, 2.0)?;
        check_distinct("ground.labamp.eight", eight.names())?;
    }
    config.direct.as_ref().map_or(Ok(()), |direct| direct.check("ground.labamp.direct"))
}

impl DirectConfig {
    /// Names of force x, y, z.
    pub(super) fn force(&self) -> [Option<String>; 3] {
        [&self.fx, &self.fy, &self.fz].map(Clone::clone)
    }

    /// Names of moment x, y, z.
    pub(super) fn moment(&self) -> [Option<String>; 3] {
        [&self.mx, &self.my, &self.mz].map(Clone::clone)
    }

    /// `key` is the section.
    pub(super) fn check(&self, key: &'static str) -> Checked {
        let pair = |one: &Option<String>, other: &Option<String>| one.is_some() == other.is_some();
        if self.fz.is_none() || !pair(&self.fx, &self.fy) || !pair(&self.mx, &self.my) {
            let what =
                "fz must be named, and fx with fy, mx with my: one of the two without the other says nothing";
            return Err((key, what.to_owned()));
        }
        let names = [&self.fx, &self.fy, &self.fz, &self.mx, &self.my, &self.mz];
        check_distinct(key, names.into_iter().flatten())
    }
}
