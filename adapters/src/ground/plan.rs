//! Maps configured channel names to positions in a scan, and checks units.

use super::channels::{Channels, Direct, EightChannels, ForceUnit, MomentUnit};
use super::reading::Load;
use crate::units::letters;

/// A channel as described by the device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct DeviceChannel {
    /// The device's unique name of the channel.
    pub(super) name: String,
    /// The user's label of the channel; not necessarily unique.
    pub(super) label: String,
    /// Its unit, as the device writes it; empty if unspecified.
    pub(super) unit: String,
}

/// Meaning of the channels; each is named by the device's name or by its label.
#[derive(Debug, Clone, PartialEq)]
pub enum Plan {
    /// A Kistler plate with eight channels: fx12, fx34, fy14, fy23, fz1, fz2, fz3, fz4.
    Eight {
        /// Their names, in that order.
        names: [String; 8],
        /// Distance of the sensors from the plate's centre along x, m.
        a_m: f64,
        /// The same along y, m.
        b_m: f64,
    },
    /// Channels that are components of force and moment, for example virtual channels.
    Direct {
        /// Names of force x, y, z.
        force: [Option<String>; 3],
        /// Names of moment x, y, z.
        moment: [Option<String>; 3],
    },
}

/// A plan resolved against the device's channels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ResolvedPlan {
    channels: Channels,
    /// Value of one unit of each channel in N or N m; 0 for unused channels.
    unit: Vec<f64>,
    values: Vec<f64>,
}

impl ResolvedPlan {
    /// Numbers in a scan.
    pub(super) fn count(&self) -> usize {
        self.unit.len()
    }

    pub(super) fn load(&mut self, values: &[f64]) -> Load {
        for ((scaled, value), unit) in self.values.iter_mut().zip(values).zip(&self.unit) {
            // An unused channel may have any value, infinity included.
            *scaled = if *unit == 0.0 { 0.0 } else { value * unit };
        }
        self.channels.load(&self.values)
    }
}

/// Device-specific wording of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Wording {
    /// The device.
    pub(super) device: &'static str,
    /// The section of the configuration that names its channels.
    pub(super) section: &'static str,
    /// Remedy for a missing channel.
    pub(super) missing: &'static str,
    /// Remedy for an unsuitable unit.
    pub(super) unit: &'static str,
}

const FORCE: &str = "force";
const MOMENT: &str = "moment";

impl Plan {
    /// Resolves every name among the device's channels and checks that its unit fits the quantity.
    ///
    /// # Errors
    /// What does not fit, and the remedy, in a sentence.
    pub(super) fn fit(
        &self,
        channels_of_device: &[DeviceChannel],
        wording: Wording,
    ) -> Result<ResolvedPlan, String> {
        self.fit_with(channels_of_device, wording, [None; 2])
    }

    /// As [`Self::fit`], with default units of force and moment for channels without a unit.
    pub(super) fn fit_with(
        &self,
        channels_of_device: &[DeviceChannel],
        wording: Wording,
        [force_unit, moment_unit]: [Option<&str>; 2],
    ) -> Result<ResolvedPlan, String> {
        let mut unit = vec![0.0; channels_of_device.len()];
        let mut find = |name: &str, in_base: fn(&str) -> Option<f64>, kind: &str| {
            let (index, channel) = find_channel(channels_of_device, name, wording)?;
            let declared = if kind == FORCE { force_unit } else { moment_unit };
            let written = match (channel.unit.as_str(), declared) {
                ("", Some(declared)) => declared,
                (written, _) => written,
            };
            unit[index] = in_base(written).ok_or_else(|| {
                let Wording { device, unit, .. } = wording;
                let written = if channel.unit.is_empty() {
                    "has no unit".to_owned()
                } else {
                    format!("is in {:?}, which is no unit of {kind}", channel.unit)
                };
                format!("channel {name} of {device} {written}: {unit}")
            })?;
            Ok::<usize, String>(index)
        };
        let channels = match self {
            Plan::Eight { names, a_m, b_m } => {
                let mut channels = [0; 8];
                for (channel, name) in channels.iter_mut().zip(names) {
                    *channel = find(name, newtons, FORCE)?;
                }
                let eight = EightChannels {
                    channels,
                    a_m: *a_m,
                    b_m: *b_m,
                    newtons_per_unit: [1.0; 8],
                    zero: [0.0; 8],
                };
                Channels::eight(channels_of_device.len(), &eight)
            }
            Plan::Direct { force, moment } => {
                let mut direct = Direct::default();
                for (place, name) in direct.force.iter_mut().zip(force) {
                    *place = name.as_deref().map(|name| find(name, newtons, FORCE)).transpose()?;
                }
                for (place, name) in direct.moment.iter_mut().zip(moment) {
                    *place = name.as_deref().map(|name| find(name, newton_metres, MOMENT)).transpose()?;
                }
                Channels::direct(channels_of_device.len(), direct, ForceUnit::Newton, MomentUnit::NewtonMetre)
            }
        };
        let channels = channels.map_err(|fault| format!("[{}]: {fault}", wording.section))?;
        Ok(ResolvedPlan { channels, values: vec![0.0; unit.len()], unit })
    }
}

fn find_channel<'a>(
    channels_of_device: &'a [DeviceChannel],
    name: &str,
    wording: Wording,
) -> Result<(usize, &'a DeviceChannel), String> {
    let Wording { device, section, missing, .. } = wording;
    let places = || channels_of_device.iter().enumerate();
    let by_name = places().find(|(_, channel)| channel.name.eq_ignore_ascii_case(name));
    let by_label: Vec<_> = places().filter(|(_, channel)| channel.label.eq_ignore_ascii_case(name)).collect();
    let there = || {
        let called = |channel: &DeviceChannel| match channel.label.as_str() {
            "" => channel.name.clone(),
            label => format!("{} ({label})", channel.name),
        };
        channels_of_device.iter().map(called).collect::<Vec<_>>().join(", ")
    };
    match (by_name, &by_label[..]) {
        (Some(found), _) => Ok(found),
        (None, [found]) => Ok(*found),
        (None, []) => {
            Err(format!("{device} has no channel {name} but {}: {missing}, or correct [{section}]", there()))
        }
        (None, _) => Err(format!(
            "{device} has several channels {name}: tell them apart by their own names, {}",
            there()
        )),
    }
}

/// Whether these are accepted spellings of a unit of force and of a unit of moment.
pub fn units_are_known(force: &str, moment: &str) -> (bool, bool) {
    (newtons(force).is_some(), newton_metres(moment).is_some())
}

/// Newtons per unit. Case matters: mN is not MN.
fn newtons(unit: &str) -> Option<f64> {
    match unit.trim() {
        "mN" => Some(1e-3),
        "N" | "newton" | "newtons" | "Newton" | "Newtons" => Some(ForceUnit::Newton.newtons()),
        "kN" => Some(ForceUnit::Kilonewton.newtons()),
        "lbf" => Some(ForceUnit::PoundForce.newtons()),
        "kgf" | "kp" => Some(ForceUnit::KilogramForce.newtons()),
        _ => None,
    }
}

/// Newton metres per unit.
fn newton_metres(unit: &str) -> Option<f64> {
    match letters(unit)?.as_str() {
        "Nm" => Some(MomentUnit::NewtonMetre.newton_metres()),
        "Nmm" => Some(MomentUnit::NewtonMillimetre.newton_metres()),
        "Ncm" => Some(1e-2),
        "kNm" => Some(MomentUnit::KilonewtonMetre.newton_metres()),
        "lbfin" => Some(MomentUnit::PoundForceInch.newton_metres()),
        "lbfft" => Some(MomentUnit::PoundForceFoot.newton_metres()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stiffness_is_no_moment() {
        assert_eq!(units_are_known("N", "N·m"), (true, true));
        assert_eq!(units_are_known("N/m", "N/m"), (false, false));
        assert_eq!((newton_metres("N-mm"), newton_metres("N/mm")), (Some(1e-3), None));
    }
}
