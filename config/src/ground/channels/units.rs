//! Units of the configuration.

use equipoise_adapters::ground::channels::{ForceUnit, MomentUnit};
use serde::{Deserialize, Serialize};

/// Unit of a force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ForceConfig {
    /// Newtons.
    #[serde(rename = "N")]
    Newton,
    /// Kilonewtons.
    #[serde(rename = "kN")]
    Kilonewton,
    /// Pounds-force.
    #[serde(rename = "lbf")]
    PoundForce,
    /// Kilograms-force, as indicated by scales.
    #[serde(rename = "kgf")]
    KilogramForce,
}

/// Unit of a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum MomentConfig {
    /// Newton metres.
    #[serde(rename = "N m")]
    NewtonMetre,
    /// Newton millimetres.
    #[serde(rename = "N mm")]
    NewtonMillimetre,
    /// Kilonewton metres.
    #[serde(rename = "kN m")]
    KilonewtonMetre,
    /// Pound-force inches.
    #[serde(rename = "lbf in")]
    PoundForceInch,
    /// Pound-force feet.
    #[serde(rename = "lbf ft")]
    PoundForceFoot,
}

/// Unit of a length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum LengthConfig {
    /// Metres.
    #[serde(rename = "m")]
    Metre,
    /// Centimetres.
    #[serde(rename = "cm")]
    Centimetre,
    /// Millimetres.
    #[serde(rename = "mm")]
    Millimetre,
    /// Inches.
    #[serde(rename = "in")]
    Inch,
}

impl From<ForceConfig> for ForceUnit {
    fn from(config: ForceConfig) -> ForceUnit {
        match config {
            ForceConfig::Newton => ForceUnit::Newton,
            ForceConfig::Kilonewton => ForceUnit::Kilonewton,
            ForceConfig::PoundForce => ForceUnit::PoundForce,
            ForceConfig::KilogramForce => ForceUnit::KilogramForce,
        }
    }
}

impl From<MomentConfig> for MomentUnit {
    fn from(config: MomentConfig) -> MomentUnit {
        match config {
            MomentConfig::NewtonMetre => MomentUnit::NewtonMetre,
            MomentConfig::NewtonMillimetre => MomentUnit::NewtonMillimetre,
            MomentConfig::KilonewtonMetre => MomentUnit::KilonewtonMetre,
            MomentConfig::PoundForceInch => MomentUnit::PoundForceInch,
            MomentConfig::PoundForceFoot => MomentUnit::PoundForceFoot,
        }
    }
}

impl ForceConfig {
    /// One unit in N.
    pub fn newtons(self) -> f64 {
        ForceUnit::from(self).newtons()
    }
}

impl MomentConfig {
    /// One unit in N m.
    pub fn newton_metres(self) -> f64 {
        MomentUnit::from(self).newton_metres()
    }
}

impl LengthConfig {
    /// One unit in m.
    pub fn metres(self) -> f64 {
        match self {
            LengthConfig::Metre => 1.0,
            LengthConfig::Centimetre => 1e-2,
            LengthConfig::Millimetre => 1e-3,
            LengthConfig::Inch => 0.0254,
        }
    }
}
