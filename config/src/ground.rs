//! `[ground]`: the ground devices. Keys that several devices share are defined here; keys of a single device are in
//! separate sections and files.

pub mod amti;
pub mod ati_rdt;
pub mod binary;
pub mod bota;
pub mod channels;
mod description_error;
pub mod labamp;
pub mod lsl;
pub mod moticon;
pub mod numbers;
pub mod qtm;
pub mod second;
mod sections;
pub mod serial;
pub mod tec_gihan;
pub mod text;
pub mod transport;
mod z_down;

use std::net::SocketAddr;

use equipoise_adapters::ground::{self, GroundDevice, GroundFrame, GroundSettings, SensorAxes};
use equipoise_adapters::source::{SourceError, Transport};
use equipoise_core::cycle::Settings;
use equipoise_core::message::GroundDevice as DeviceKind;
use serde::{Deserialize, Serialize};

use super::latencies::{LATENCY_MAX_MS, span_ns};
use super::method::{Checked, between};
pub use description_error::DescriptionError;
pub(super) use second::InvalidField;

/// Maximum height of a surface above its sensor's origin, m: plates of all supported makers are below 0.1 m; the rest is
/// for a platform on sensors.
const SURFACE_HEIGHT_MAX_M: f64 = 0.5;
/// Maximum height of the walking surface above or below the suit's floor (z = 0), m: a step of a stair is at most 0.2 m;
/// the rest is for a suit's floor that is off.
const SURFACE_Z_MAX_M: f64 = 0.3;

/// `[ground]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroundConfig {
    /// Source of samples.
    pub source: GroundSourceKind,
    /// Address of a network device; by default the device's standard port on this PC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub address: Option<SocketAddr>,
    /// Listening address, for sources that send without a request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub listen: Option<SocketAddr>,
    /// Accept datagrams from other machines on `listen`; otherwise only from this machine.
    #[serde(default)]
    pub allow_remote: bool,
    /// ATI: the device's counts per newton (its page `netftapi2.xml`, `cfgcpf`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counts_per_newton: Option<f64>,
    /// ATI: the device's counts per newton metre (`cfgcpt`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counts_per_newton_metre: Option<f64>,
    /// Keys of ATI devices.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ati: Option<ati_rdt::AtiConfig>,
    /// Whether the device reports the force on itself or on the subject.
    #[serde(default)]
    pub measures: Measures,
    /// Constant delay from a force to its arrival (the device's filter), ms: subtracted from every sample time.
    #[serde(default)]
    pub latency_ms: f64,
    /// Foot on this plate, if each foot has a separate plate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub foot: Option<Foot>,
    /// Pose of the plate in the suit world.
    #[serde(default)]
    pub frame: FrameConfig,
    /// The device's serial port.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<serial::SerialConfig>,
    /// Keys of AMTI plates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amti: Option<amti::AmtiConfig>,
    /// Keys of Bota sensors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bota: Option<bota::BotaConfig>,
    /// Keys of Kistler's LabAmp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub labamp: Option<labamp::LabAmpConfig>,
    /// Keys of Tec Gihan plates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tec_gihan: Option<tec_gihan::TecGihanConfig>,
    /// Keys of Moticon insoles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moticon: Option<moticon::MoticonConfig>,
    /// Keys of Qualisys Track Manager.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub qtm: Option<qtm::QtmConfig>,
    /// Keys of the Lab Streaming Layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lsl: Option<lsl::LslConfig>,
    /// Format of text lines.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<text::TextConfig>,
    /// Format of binary frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub binary: Option<binary::BinaryConfig>,
    /// Meaning of the numbers in text lines and binary frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channels: Option<channels::ChannelsConfig>,
    /// A file written by another program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<transport::FileConfig>,
    /// A second device, fused with the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second: Option<Box<GroundConfig>>,
}

/// Source of ground samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GroundSourceKind {
    /// ATI's raw data transfer over UDP (Net F/T, Axia).
    AtiRdt,
    /// AMTI plates with a serial port.
    AmtiSerial,
    /// Sensors of Bota and Rokubi over a serial port.
    BotaSerial,
    /// Kistler's LabAmp over the network.
    KistlerLabamp,
    /// Plates of Tec Gihan over a serial port.
    TecGihan,
    /// Moticon insoles, sent by their software over UDP.
    MoticonUdp,
    /// Qualisys Track Manager, with any plate connected to it.
    Qtm,
    /// A stream of the Lab Streaming Layer.
    Lsl,
    /// Lines of text in the format of `[ground.text]`.
    Text,
    /// Binary frames in the format of `[ground.binary]`.
    Binary,
    /// Another process publishes them: `equipoise adapter ground`.
    External,
}

/// Direction of the measured force.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measures {
    /// The force on the sensor.
    #[default]
    Action,
    /// The force on the subject.
    Reaction,
}

/// A side of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Foot {
    /// The left foot.
    Left,
    /// The right foot.
    Right,
}

/// `[ground.frame]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FrameConfig {
    /// Whether the sensor's z axis points up or down.
    pub axes: Axes,
    /// The sensor's origin in the suit world, m.
    pub origin_m: [f64; 3],
    /// Rotation of the plate to the left, degrees.
    pub yaw_deg: f64,
    /// Walking surface above the sensor's origin, m.
    pub surface_height_m: f64,
    /// Lengths of the surface along the sensor's x and y, m, centred on its origin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_m: Option<[f64; 2]>,
}

/// Direction of a sensor's z axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axes {
    /// Up.
    #[default]
    ZUp,
    /// Down, as with Kistler and AMTI plates.
    ZDown,
}

impl GroundConfig {
    /// The section as TOML, defaults included.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.ground_latency_ns = self.loop_latency_ns();
    }

    /// `latency_ms` in ns.
    pub fn latency_ns(&self) -> u64 {
        span_ns(self.latency_ms)
    }

    /// Sign, pose and constant delay of the device.
    pub fn settings(&self) -> GroundSettings {
        GroundSettings {
            measures: match self.measures {
                Measures::Action => ground::Measures::Action,
                Measures::Reaction => ground::Measures::Reaction,
            },
            frame: GroundFrame {
                axes: match self.frame.axes {
                    Axes::ZUp => SensorAxes::ZUp,
                    Axes::ZDown => SensorAxes::ZDown,
                },
                origin_m: self.frame.origin_m,
                yaw_rad: self.frame.yaw_deg.to_radians(),
                surface_height_m: self.frame.surface_height_m,
            },
            latency_ns: self.latency_ns(),
            device: if self.is_insoles() { DeviceKind::Insoles } else { DeviceKind::Plate },
        }
    }

    /// The decoder of the device's bytes; `None` if another process reads them.
    ///
    /// # Errors
    /// A section that the device requires is missing.
    pub fn device(&self) -> Result<Option<Box<dyn GroundDevice>>, SourceError> {
        Ok(Some(match self.source {
            GroundSourceKind::AtiRdt => ati_rdt::device(self),
            GroundSourceKind::AmtiSerial => amti::device(self)?,
            GroundSourceKind::BotaSerial => bota::device(self)?,
            GroundSourceKind::KistlerLabamp => labamp::device(self)?,
            GroundSourceKind::TecGihan => tec_gihan::device(self)?,
            GroundSourceKind::MoticonUdp => moticon::device(self)?,
            GroundSourceKind::Qtm => qtm::device(self)?,
            GroundSourceKind::Lsl => lsl::device(self)?,
            GroundSourceKind::Text => text::device(self)?,
            GroundSourceKind::Binary => binary::device(self)?,
            GroundSourceKind::External => return Ok(None),
        }))
    }

    /// The transport to the device; `None` if another process reads it.
    ///
    /// # Errors
    /// A section that the transport requires is missing.
    pub fn transport(&self) -> Result<Option<Box<dyn Transport>>, SourceError> {
        Ok(Some(match self.source {
            GroundSourceKind::AtiRdt => ati_rdt::transport(self),
            GroundSourceKind::AmtiSerial => amti::transport(self)?,
            GroundSourceKind::BotaSerial => bota::transport(self)?,
            GroundSourceKind::KistlerLabamp => labamp::transport(self)?,
            GroundSourceKind::TecGihan => tec_gihan::transport(self)?,
            GroundSourceKind::MoticonUdp => moticon::transport(self)?,
            GroundSourceKind::Qtm => qtm::transport(self)?,
            GroundSourceKind::Lsl => lsl::transport(self)?,
            GroundSourceKind::Text => text::transport(self)?,
            GroundSourceKind::Binary => binary::transport(self)?,
            GroundSourceKind::External => return Ok(None),
        }))
    }

    /// The source of a device that sends blocks, also if another process reads it with the keys of this section.
    fn block_source(&self) -> GroundSourceKind {
        match self.source {
            GroundSourceKind::External if self.tec_gihan.is_some() => GroundSourceKind::TecGihan,
            GroundSourceKind::External if self.labamp.is_some() => GroundSourceKind::KistlerLabamp,
            source => source,
        }
    }

    /// Duration of a block of samples; 0 if the device sends samples individually.
    pub(super) fn block_ns(&self) -> u64 {
        match self.block_source() {
            GroundSourceKind::TecGihan => tec_gihan::block_ns(self),
            GroundSourceKind::KistlerLabamp => labamp::block_ns(self),
            _ => 0,
        }
    }

    /// The key that determines the length of blocks, if the device sends blocks.
    pub(super) fn gathers(&self) -> Option<&'static str> {
        match self.block_source() {
            GroundSourceKind::TecGihan => Some("ground.tec_gihan.rate_hz"),
            GroundSourceKind::KistlerLabamp => Some("ground.labamp.rate_hz"),
            _ => None,
        }
    }

    /// Samples per second according to the configuration; `None` if it does not state them.
    pub(super) fn configured_rate_hz(&self) -> Option<f64> {
        match self.block_source() {
            GroundSourceKind::TecGihan => Some(tec_gihan::rate_hz(self)),
            GroundSourceKind::KistlerLabamp => labamp::samples_hz(self),
            _ => None,
        }
    }

    /// Address or serial port of the device, for messages; of both devices if there are two.
    pub fn location(&self) -> String {
        match &self.second {
            Some(second) => {
                format!("{} and {}", self.own_location(), second::in_second(&second.own_location()))
            }
            None => self.own_location(),
        }
    }

    /// The same for this device only.
    pub fn own_location(&self) -> String {
        match (self.source, &self.serial) {
            (GroundSourceKind::AtiRdt, _) => format!("ground.address = {}", ati_rdt::address(self)),
            (_, Some(serial)) => format!("ground.serial.port = {}", serial.port.display()),
            _ if self.file.is_some() => {
                let path = self.file.as_ref().map(|file| file.path.display().to_string());
                format!("ground.file.path = {}", path.unwrap_or_default())
            }
            _ => match (self.address, self.listen) {
                (Some(address), _) => format!("ground.address = {address}"),
                (_, Some(listen)) => format!("ground.listen = {listen}"),
                _ => "[ground]".to_owned(),
            },
        }
    }

    /// Checks this device only; [`Self::check_second`] checks both together.
    pub(super) fn check(&self) -> Checked {
        match self.source {
            GroundSourceKind::AtiRdt => ati_rdt::check(self)?,
            GroundSourceKind::KistlerLabamp => labamp::check(self)?,
            GroundSourceKind::TecGihan => tec_gihan::check(self)?,
            GroundSourceKind::AmtiSerial => amti::check(self)?,
            GroundSourceKind::BotaSerial => bota::check(self)?,
            GroundSourceKind::Qtm => qtm::check(self)?,
            GroundSourceKind::Lsl => lsl::check(self)?,
            _ => {}
        }
        between("ground.latency_ms", self.latency_ms, 0.0, LATENCY_MAX_MS)?;
        self.frame.check()
    }
}

impl GroundConfig {
    /// Checks a device description, whose errors may be in an entry of a list.
    pub(super) fn check_description(&self) -> Result<(), DescriptionError> {
        sections::check(self)?;
        match self.source {
            GroundSourceKind::Text => text::check(self)?,
            GroundSourceKind::Binary => binary::check(self)?,
            GroundSourceKind::MoticonUdp => moticon::check(self)?,
            _ => {}
        }
        sections::check_connection(self)?;
        match &self.second {
            Some(second) => second.check_description().map_err(DescriptionError::in_second),
            None => Ok(()),
        }
    }
}

impl FrameConfig {
    /// The section as TOML, defaults included.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    fn check(&self) -> Checked {
        let numbers = self.origin_m.iter().chain([&self.yaw_deg, &self.surface_height_m]);
        if numbers.clone().any(|value| !value.is_finite()) {
            return Err(("ground.frame", "every number must be finite".to_owned()));
        }
        if self.origin_m.iter().any(|metres| metres.abs() > 100.0) {
            return Err(("ground.frame", "metres are expected; a plate 100 m away is a mistake".to_owned()));
        }
        between("ground.frame.surface_height_m", self.surface_height_m, 0.0, SURFACE_HEIGHT_MAX_M)?;
        let surface_z_m = self.origin_m[2] + self.surface_height_m;
        if surface_z_m.abs() > SURFACE_Z_MAX_M {
            let reason = format!(
                "origin_m[2] + surface_height_m, the height of the walking surface above the suit's floor, is \
                 {surface_z_m:.3} m; at most ±{SURFACE_Z_MAX_M} m is expected"
            );
            return Err(("ground.frame.origin_m", reason));
        }
        if self.size_m.is_some_and(|size_m| !size_m.iter().all(|length_m| (0.01..=10.0).contains(length_m))) {
            return Err(("ground.frame.size_m", "two lengths from 0.01 to 10 m are expected".to_owned()));
        }
        Ok(())
    }

    /// Corners of the surface in the suit world, in turn, m; `None` without `size_m`.
    pub fn corners_m(&self) -> Option<[[f64; 2]; 4]> {
        let [half_x, half_y] = self.size_m?.map(|length_m| 0.5 * length_m);
        let (sin, cos) = self.yaw_deg.to_radians().sin_cos();
        let [x, y, _] = self.origin_m;
        let corner = |[a, b]: [f64; 2]| [x + cos * a - sin * b, y + sin * a + cos * b];
        Some([[half_x, half_y], [half_x, -half_y], [-half_x, -half_y], [-half_x, half_y]].map(corner))
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod net_tests;
