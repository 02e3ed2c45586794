//! The devices of a ground sample, as reported by `status` and `doctor`.

use std::io::Write;

use equipoise_core::message::{Component, FootFrame, GroundDevice, GroundSample};
use serde::Serialize;

const DEVICES: [(GroundDevice, &str); 3] = [
    (GroundDevice::Plate, "plate"),
    (GroundDevice::SecondPlate, "second_plate"),
    (GroundDevice::Insoles, "insoles"),
];
const COMPONENTS: [(Component, &str); 3] =
    [(Component::Shear, "shear"), (Component::Tilt, "tilt"), (Component::FreeMoment, "free_moment")];

/// Devices of a ground sample and the quantities they measure.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Provenance {
    /// The devices.
    devices: Vec<&'static str>,
    /// Whether each foot was measured separately.
    per_foot: bool,
    /// Frame of the feet's centres of pressure: `world` or `sole`.
    #[serde(skip_serializing_if = "Option::is_none")]
    foot_frame: Option<&'static str>,
    /// Quantities that the devices do not measure.
    not_measured: Vec<&'static str>,
}

impl Provenance {
    pub(crate) fn of(sample: &GroundSample) -> Provenance {
        let frame = if sample.foot_frame == FootFrame::Insole as u32 { "sole" } else { "world" };
        let devices = DEVICES.iter().filter(|(device, _)| sample.devices & *device as u32 != 0);
        let missing = COMPONENTS.iter().filter(|(component, _)| !sample.measures(*component));
        Provenance {
            devices: devices.map(|(_, name)| *name).collect(),
            per_foot: sample.per_foot == 1,
            foot_frame: (sample.per_foot == 1).then_some(frame),
            not_measured: missing.map(|(_, name)| *name).collect(),
        }
    }

    /// Text on the quantities that the devices do not measure; empty if there are none.
    pub(crate) fn missing(&self) -> String {
        if self.not_measured.is_empty() {
            return String::new();
        }
        format!("; not measured: {}", list_names(&self.not_measured))
    }

    /// Text on the devices.
    pub(crate) fn devices(&self) -> String {
        list_names(&self.devices)
    }

    /// Whether one plate measures all quantities.
    pub(crate) fn is_one_plate(&self) -> bool {
        self.devices == ["plate"] && self.not_measured.is_empty()
    }

    pub(crate) fn write(&self, out: &mut impl Write) -> std::io::Result<()> {
        write!(out, "  feet    on {}", self.devices())?;
        match self.foot_frame {
            Some("sole") => write!(out, ", each measured by itself, in its sole's frame")?,
            Some(_) => write!(out, ", each measured by itself")?,
            None => write!(out, ", measured together")?,
        }
        writeln!(out, "{}", self.missing())
    }
}

fn list_names(names: &[&str]) -> String {
    names.join(" and ").replace('_', " ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_sample_of_insoles_names_its_unavailable_quantities() {
        let sample = GroundSample {
            devices: GroundDevice::Insoles as u32,
            per_foot: 1,
            foot_frame: FootFrame::Insole as u32,
            not_measured: Component::Shear as u32 | Component::FreeMoment as u32,
            ..Zeroable::zeroed()
        };
        let mut text = Vec::new();
        Provenance::of(&sample).write(&mut text).unwrap();
        let expected = "  feet    on insoles, each measured by itself, in its sole's frame; not measured: shear and free moment\n";
        assert_eq!(String::from_utf8(text).unwrap(), expected);
    }
}
