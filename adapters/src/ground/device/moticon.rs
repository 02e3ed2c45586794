//! Moticon insoles, as forwarded by Moticon's software over UDP: one line of text for each sample.
//!
//! The fields of a line depend on the channels selected in that software; with all of them a line has 51 fields.
//! Source: four public receivers (hermes-moticon, PhysioSense, OpenSimRT, ActionNet). They agree that the centre of
//! pressure ranges from -0.5 to 0.5 of the insole's length (x) and width (y). None defines which end of x is the toe.
//! According to the maker, the coordinates are the same for both sides, but the direction of y (medial or lateral) is
//! not documented: it must be configured, or determined by trial.

use super::text::{Column, Framing, Text, TextSettings, Validator};
use super::{Action, GroundDevice};
use crate::ground::channels::{ChannelFault, Channels, Insole};
use crate::ground::reading::Decoded;
use crate::ground::refusal::GroundRefusal;
use crate::wire::text_line::{Decimal, Delimiter, LineForm, Unit};

/// Pressure sensors of an insole.
pub const PRESSURES: usize = 16;
/// A centre beyond this fraction of length or width is invalid: the fields are not as configured.
const EDGE: f64 = 0.55;
/// With this force, N, at least one pressure sensor must respond; if none responds, the force must be less.
const CARRIES_N: f64 = 50.0;
/// This many contradictory samples in a row are reported.
const REPORTED_AFTER_SAMPLES: u32 = 20;
const LONGEST: usize = 4096;

/// Direction of y.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sideways {
    /// Medially, to the inner edge of each foot.
    Medial,
    /// Laterally, to the outer edge of each foot.
    Lateral,
    /// To the left, for both feet.
    Left,
    /// To the right, for both feet.
    Right,
}

impl Sideways {
    /// Whether y points to the left on the left foot, and on the right foot, as the sole's own Y does.
    pub fn left_is_up(self) -> [bool; 2] {
        match self {
            Sideways::Medial => [false, true],
            Sideways::Lateral => [true, false],
            Sideways::Left => [true, true],
            Sideways::Right => [false, false],
        }
    }
}

/// Order of the fields, and orientation of the insoles.
#[derive(Debug, Clone, PartialEq)]
pub struct MoticonSettings {
    /// Names of the fields in their order, as in [`all_fields`]; `-` for an unused field.
    pub fields: Vec<String>,
    /// Length of the insoles, m.
    pub length_m: f64,
    /// Their width, m.
    pub width_m: f64,
    /// Whether x points to the toe rather than to the heel.
    pub x_to_tip: bool,
    /// Direction of y.
    pub y: Sideways,
    /// The insole labelled left is worn on the right foot.
    pub swapped: bool,
    /// Unit of the time.
    pub time: Unit,
}

/// Names of the fields with all channels selected, in their order.
pub fn all_fields() -> Vec<String> {
    let mut names = vec!["time".to_owned()];
    for side in ["left", "right"] {
        for name in ["acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z", "cop_x", "cop_y"] {
            names.push(format!("{side}_{name}"));
        }
        names.extend((1..=PRESSURES).map(|sensor| format!("{side}_pressure_{sensor}")));
        names.push(format!("{side}_force"));
    }
    names
}

/// Why a list of fields is invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FieldsFault {
    /// A required field is missing.
    #[error(
        "no field is `{0}`: tick time, centre of pressure and total force of both sides in Moticon's software"
    )]
    Missing(String),
    /// An undefined name.
    #[error("`{0}` is no field of Moticon's; one that is not read is called \"-\"")]
    Unknown(String),
    /// A duplicate field.
    #[error("`{0}` stands there twice")]
    Twice(String),
    /// Invalid length or width.
    #[error(transparent)]
    Size(#[from] ChannelFault),
}

/// A pair of insoles.
#[derive(Debug, Clone)]
pub struct Moticon {
    text: Text<Insoles>,
}

impl Moticon {
    /// Insoles before any data.
    ///
    /// # Errors
    /// [`FieldsFault`].
    pub fn new(settings: &MoticonSettings) -> Result<Moticon, FieldsFault> {
        let place = |name: &str| settings.fields.iter().position(|field| field == name);
        let needed = |name: String| place(&name).ok_or(FieldsFault::Missing(name));
        let known = all_fields();
        for (index, name) in settings.fields.iter().enumerate().filter(|(_, name)| *name != "-") {
            if !known.contains(name) {
                return Err(FieldsFault::Unknown(name.clone()));
            }
            if place(name) != Some(index) {
                return Err(FieldsFault::Twice(name.clone()));
            }
        }
        let time = needed("time".to_owned())?;
        let sides = if settings.swapped { ["right", "left"] } else { ["left", "right"] };
        let mut fields = Vec::new();
        for side in sides {
            for name in ["force", "cop_x", "cop_y"] {
                fields.push(needed(format!("{side}_{name}"))?);
            }
        }
        let mut pressures = [(0, 0); 2];
        for (side, (from, to)) in sides.into_iter().zip(&mut pressures) {
            *from = fields.len();
            fields.extend((1..=PRESSURES).filter_map(|sensor| place(&format!("{side}_pressure_{sensor}"))));
            *to = fields.len();
        }
        let channels = Channels::insoles(fields.len(), settings.insoles())?;
        let form = LineForm {
            delimiter: Delimiter::Spaces,
            decimal: Decimal::Point,
            comment: None,
            prefix: Vec::new(),
            fields: settings.fields.len(),
        };
        let text = TextSettings {
            form,
            framing: Framing::Datagrams,
            header_lines: 0,
            longest: LONGEST,
            columns: fields.into_iter().map(|field| Column { field, scale: 1.0, offset: 0.0 }).collect(),
            channels,
            time: Some((time, settings.time)),
            sequence: None,
        };
        Ok(Moticon { text: Text::with_validator(text, Insoles { pressures, ..Insoles::default() }) })
    }
}

impl MoticonSettings {
    /// Left, right; force, x and y of each foot are consecutive channels.
    fn insoles(&self) -> [Insole; 2] {
        let x_m = if self.x_to_tip { self.length_m } else { -self.length_m };
        let left_is_up = self.y.left_is_up();
        [0, 1].map(|side| Insole {
            vertical: 3 * side,
            cop: [3 * side + 1, 3 * side + 2],
            newtons_per_unit: 1.0,
            metres_per_unit: [x_m, if left_is_up[side] { self.width_m } else { -self.width_m }],
        })
    }
}

impl GroundDevice for Moticon {
    fn opened(&mut self, now_ns: u64) {
        self.text.opened(now_ns);
    }

    fn take(&mut self, bytes: &[u8], arrival_ns: u64, decoded: &mut Decoded) {
        self.text.take(bytes, arrival_ns, decoded);
    }

    fn next_action(&mut self, now_ns: u64) -> Action {
        self.text.next_action(now_ns)
    }

    fn diagnostic(&self) -> Option<String> {
        self.text.diagnostic()
    }
}

/// Plausibility check of insoles: range of the centre, and no force without pressure.
#[derive(Debug, Clone, Copy, Default)]
struct Insoles {
    /// Channel ranges of each side's pressures; empty if they are not selected.
    pressures: [(usize, usize); 2],
    outside: u32,
    contradiction: u32,
}

impl Validator for Insoles {
    fn validate(&mut self, values: &[f64]) -> Result<(), GroundRefusal> {
        let mut contradicts = false;
        for (foot, (from, to)) in values.chunks_exact(3).zip(self.pressures) {
            let [force_n, x, y] = [foot[0], foot[1], foot[2]];
            // The receiver refuses NaN.
            if force_n > 0.0 && (x.abs() > EDGE || y.abs() > EDGE) {
                self.outside = self.outside.saturating_add(1);
                return Err(GroundRefusal::Implausible);
            }
            let pressures = values.get(from..to).unwrap_or_default();
            contradicts |= force_n > CARRIES_N
                && !pressures.is_empty()
                && pressures.iter().all(|pressure| *pressure == 0.0);
        }
        self.outside = 0;
        self.contradiction = if contradicts { self.contradiction.saturating_add(1) } else { 0 };
        Ok(())
    }

    fn diagnostic(&self) -> Option<String> {
        if self.outside >= REPORTED_AFTER_SAMPLES {
            let said = "a foot carries force and its centre of pressure lies outside the insole: the fields are not in the order of \
                        ground.moticon.fields; compare it with the channels ticked in Moticon's software";
            return Some(said.to_owned());
        }
        (self.contradiction >= REPORTED_AFTER_SAMPLES).then(|| {
            "a foot carries force while none of its sensors feels pressure: the fields are not in the order of \
             ground.moticon.fields; compare it with the channels ticked in Moticon's software"
                .to_owned()
        })
    }
}

#[cfg(test)]
mod tests;
