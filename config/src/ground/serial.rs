//! `[ground.serial]`: the serial port of a device.

use std::path::PathBuf;

use equipoise_adapters::source::{Flow, LineSettings, SerialLine, SourceError, Transport};
use serde::{Deserialize, Serialize};

use super::GroundConfig;
use crate::method::{Checked, between};

/// `[ground.serial]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SerialConfig {
    /// The port, for example `/dev/ttyUSB0`, or better a persistent name under `/dev/serial/by-id/`.
    pub port: PathBuf,
    /// Speed, baud; by default the device's standard speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// Whether RTS and CTS control the flow; by default the device's standard setting.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rts_cts: Option<bool>,
}

/// Defaults of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SerialDefaults {
    /// Speed, baud.
    pub baud: u32,
    /// Flow control.
    pub flow: Flow,
}

/// The configured serial port.
///
/// # Errors
/// `[ground.serial]` is missing; [`check`] reports it first.
pub fn line(ground: &GroundConfig, defaults: SerialDefaults) -> Result<Box<dyn Transport>, SourceError> {
    let missing = || SourceError::Unusable(format!("ground.serial: {MISSING}"));
    let serial = ground.serial.as_ref().ok_or_else(missing)?;
    let flow = match serial.rts_cts {
        Some(true) => Flow::RtsCts,
        Some(false) => Flow::Free,
        None => defaults.flow,
    };
    Ok(Box::new(SerialLine::new(LineSettings {
        port: serial.port.clone(),
        baud: baud(ground, defaults),
        flow,
        key: "ground.serial.port",
    })))
}

/// Speed of the port, baud.
pub fn baud(ground: &GroundConfig, defaults: SerialDefaults) -> u32 {
    ground.serial.as_ref().and_then(|serial| serial.baud).unwrap_or(defaults.baud)
}

const MISSING: &str =
    "must be given for a device on a serial line: [ground.serial] with port = \"/dev/serial/by-id/…\"";

/// Check for devices that require a serial port.
pub fn check(ground: &GroundConfig) -> Checked {
    let Some(serial) = &ground.serial else {
        return Err(("ground.serial", MISSING.to_owned()));
    };
    if !serial.port.is_absolute() {
        let what = format!("{} is no path from the root, as /dev/ttyUSB0 is", serial.port.display());
        return Err(("ground.serial.port", what));
    }
    match serial.baud {
        Some(baud) => between("ground.serial.baud", f64::from(baud), 300.0, 12_000_000.0),
        None => Ok(()),
    }
}
