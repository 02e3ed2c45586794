//! `[ground.channels.insoles]`: insoles of any make.

use equipoise_adapters::ground::Channels;
use equipoise_adapters::ground::channels::Insole;
use equipoise_adapters::ground::device::moticon::Sideways;
use serde::{Deserialize, Serialize};

use super::{ForceConfig, Names};
use crate::ground::description_error::DescriptionError;

/// `[ground.channels.insoles]`: channels `left_force`, `left_cop_x`, `left_cop_y`, `right_force`, `right_cop_x`,
/// `right_cop_y`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InsolesConfig {
    /// Unit of the forces.
    pub force: ForceConfig,
    /// Unit of the centre of pressure, from the middle of the sole.
    pub cop: CopUnit,
    /// Length of the insoles, m, if the centre is a fraction of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
    /// Width of the insoles, m, if the centre is a fraction of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width_m: Option<f64>,
    /// Direction of increasing x.
    pub x_to: TowardsX,
    /// Direction of increasing y.
    pub y_to: TowardsY,
}

/// Unit of an insole's centre of pressure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum CopUnit {
    /// A fraction of length and width, -0.5 to 0.5.
    #[serde(rename = "share")]
    Fraction,
    /// Metres.
    #[serde(rename = "m")]
    Metre,
    /// Millimetres.
    #[serde(rename = "mm")]
    Millimetre,
}

/// An end of a sole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TowardsX {
    /// The tip.
    Tip,
    /// The heel.
    Heel,
}

/// A side of a sole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TowardsY {
    /// The inner edge of each foot.
    Medial,
    /// The outer edge of each foot.
    Lateral,
    /// The left, for both feet.
    Left,
    /// The right, for both feet.
    Right,
}

impl From<TowardsY> for Sideways {
    fn from(config: TowardsY) -> Sideways {
        match config {
            TowardsY::Medial => Sideways::Medial,
            TowardsY::Lateral => Sideways::Lateral,
            TowardsY::Left => Sideways::Left,
            TowardsY::Right => Sideways::Right,
        }
    }
}

pub(super) fn channels(config: &InsolesConfig, names: &mut Names<'_>) -> Result<Channels, DescriptionError> {
    let key = "ground.channels.insoles";
    let [length_m, width_m] = match (config.cop, config.length_m, config.width_m) {
        (CopUnit::Fraction, Some(length_m), Some(width_m)) => {
            size("ground.channels.insoles", length_m, width_m)?;
            [length_m, width_m]
        }
        (CopUnit::Metre, None, None) => [1.0; 2],
        (CopUnit::Millimetre, None, None) => [1e-3; 2],
        (CopUnit::Fraction, ..) => {
            let what = "must be given where the centre of pressure is a share of the insole, and width_m too";
            return Err(DescriptionError::new("ground.channels.insoles.length_m", what));
        }
        _ => {
            let what = "length_m and width_m are for a centre of pressure given as a share: cop = \"share\"";
            return Err(DescriptionError::new("ground.channels.insoles.cop", what));
        }
    };
    let left_is_up = Sideways::from(config.y_to).left_is_up();
    let x_m = if config.x_to == TowardsX::Tip { length_m } else { -length_m };
    let mut sole = |side: usize, name: &str| -> Result<Insole, DescriptionError> {
        let mut find = |what: &str| names.find(&format!("{name}_{what}"), key);
        Ok(Insole {
            vertical: find("force")?,
            cop: [find("cop_x")?, find("cop_y")?],
            newtons_per_unit: config.force.newtons(),
            metres_per_unit: [x_m, if left_is_up[side] { width_m } else { -width_m }],
        })
    };
    let soles = [sole(0, "left")?, sole(1, "right")?];
    Channels::insoles(names.count(), soles).map_err(super::fault("soles"))
}

/// Checks that the size is that of a foot.
pub(in crate::ground) fn size(section: &str, length_m: f64, width_m: f64) -> Result<(), DescriptionError> {
    if !(0.15..=0.40).contains(&length_m) {
        return Err(DescriptionError::new(
            format!("{section}.length_m"),
            format!("{length_m} m is no insole's length (0.15 to 0.40)"),
        ));
    }
    if !(0.04..=0.15).contains(&width_m) {
        return Err(DescriptionError::new(
            format!("{section}.width_m"),
            format!("{width_m} m is no insole's width (0.04 to 0.15)"),
        ));
    }
    Ok(())
}
