//! `[ground.qtm]`: Qualisys Track Manager.

use equipoise_adapters::ground::GroundDevice;
use equipoise_adapters::ground::device::qtm::{Qtm, QtmSettings};
use equipoise_adapters::source::{SourceError, TcpLine, Transport};
use equipoise_adapters::wire::qtm::DEFAULT_PORT;
use serde::{Deserialize, Serialize};

use super::{Axes, GroundConfig};
use crate::method::Checked;

/// `[ground.qtm]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QtmConfig {
    /// Axes in which QTM reports forces, as set on its page Project options > Force data.
    pub coordinates: Coordinates,
    /// The plate's number in QTM.
    #[serde(default = "one")]
    pub plate: u32,
    /// 1: all samples of the plate; n: one force with every n-th frame of the cameras.
    #[serde(default = "one")]
    pub divisor: u32,
}

/// Frame of the forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coordinates {
    /// The plate's axes, z down.
    Plate,
    /// The laboratory's axes, z up.
    Lab,
}

fn one() -> u32 {
    1
}

/// Maximum useful divisor of the camera's frame rate.
const DIVISOR_MAX: u32 = 10;

fn section(ground: &GroundConfig) -> Result<&QtmConfig, SourceError> {
    ground.qtm.as_ref().ok_or_else(|| SourceError::Unusable(format!("ground.qtm: {}", missing())))
}

fn missing() -> &'static str {
    "must be given for Qualisys' track manager, with coordinates = \"plate\" or \"lab\" (in QTM: Project options > Force \
     data)"
}

pub(super) fn device(ground: &GroundConfig) -> Result<Box<dyn GroundDevice>, SourceError> {
    let config = section(ground)?;
    Ok(Box::new(Qtm::new(QtmSettings { plate: config.plate, divisor: config.divisor })))
}

pub(super) fn transport(ground: &GroundConfig) -> Result<Box<dyn Transport>, SourceError> {
    let Some(address) = ground.address else {
        return Err(SourceError::Unusable(format!("ground.address: {}", no_address())));
    };
    Ok(Box::new(TcpLine::to(address, "Qualisys' track manager", "ground.address")))
}

fn no_address() -> String {
    format!("must be given for Qualisys' track manager: that PC's address and port {DEFAULT_PORT}")
}

pub(super) fn check(ground: &GroundConfig) -> Checked {
    if ground.address.is_none() {
        return Err(("ground.address", no_address()));
    }
    let Some(config) = &ground.qtm else { return Err(("ground.qtm", missing().to_owned())) };
    if config.plate == 0 {
        return Err(("ground.qtm.plate", "plates are counted from 1".to_owned()));
    }
    if !(1..=DIVISOR_MAX).contains(&config.divisor) {
        return Err(("ground.qtm.divisor", format!("{} is not from 1 to {DIVISOR_MAX}", config.divisor)));
    }
    match (config.coordinates, ground.frame.axes) {
        (Coordinates::Plate, Axes::ZDown) | (Coordinates::Lab, Axes::ZUp) => Ok(()),
        (Coordinates::Plate, Axes::ZUp) => Err((
            "ground.frame.axes",
            "must be \"z-down\" where ground.qtm.coordinates is \"plate\": QTM's plates have z down".to_owned(),
        )),
        (Coordinates::Lab, Axes::ZDown) => Err((
            "ground.frame.axes",
            "must be \"z-up\" where ground.qtm.coordinates is \"lab\"; a laboratory with another axis up is not supported"
                .to_owned(),
        )),
    }
}
