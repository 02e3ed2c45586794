//! Maps channels, the numbers of a reading in the device's order, to a [`Load`] in the sensor's axes.
//!
//! For devices whose data do not describe themselves: text, binary frames, voltages. Units are configured, never
//! guessed.

mod form;

pub use crate::units::{ForceUnit, MomentUnit};
pub use form::{Cell, Centre, Direct, EightChannels, Insole};

use super::frame::Wrench;
use super::reading::{FootLoad, Load};
use equipoise_core::message::Component;

/// The meaning of a device's channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Channels {
    count: usize,
    form: Form,
}

#[derive(Debug, Clone, PartialEq)]
enum Form {
    /// Each component of the wrench is a weighted sum of channels.
    Linear {
        /// Force x, y, z in N, moment x, y, z about the sensor's origin in N m.
        rows: [Row; 6],
        /// Channel values without load; subtracted first.
        zero: Vec<f64>,
        not_measured: u32,
    },
    Centre {
        centre: Centre,
        not_measured: u32,
    },
    Insoles([Insole; 2]),
}

#[derive(Debug, Clone, Default, PartialEq)]
struct Row {
    /// Channel and its weight.
    terms: Vec<(usize, f64)>,
    /// Value of one unit of the sum, N or N m. A separate factor keeps a plain channel's value bit-identical.
    unit: f64,
}

impl Row {
    fn of(&self, values: &[f64], zero: &[f64]) -> f64 {
        let term = |(channel, weight): &(usize, f64)| {
            weight * (value(values, Some(*channel)) - zero.get(*channel).copied().unwrap_or_default())
        };
        self.terms.iter().map(term).sum::<f64>() * self.unit
    }
}

/// Value of a channel: zero if the channel does not exist by design, NaN if the device did not send it.
fn value(values: &[f64], channel: Option<usize>) -> f64 {
    channel.map_or(0.0, |channel| values.get(channel).copied().unwrap_or(f64::NAN))
}

impl Channels {
    /// Count of numbers in a reading.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Components that a device with these channels cannot measure: a union of [`Component`] bits.
    pub fn not_measured(&self) -> u32 {
        match &self.form {
            Form::Linear { not_measured, .. } | Form::Centre { not_measured, .. } => *not_measured,
            Form::Insoles(_) => ALL_BUT_VERTICAL,
        }
    }

    /// Converts a reading to a load. Too few numbers give a load that is not finite, which the receiver refuses.
    pub fn load(&self, values: &[f64]) -> Load {
        match &self.form {
            Form::Linear { rows, zero, not_measured } => {
                let [fx, fy, fz, mx, my, mz] = core::array::from_fn(|row| rows[row].of(values, zero));
                part(Wrench { force_n: [fx, fy, fz], moment_nm: [mx, my, mz] }, *not_measured)
            }
            Form::Centre { centre, not_measured } => part(centre.wrench(values), *not_measured),
            Form::Insoles(insoles) => Load::Insoles(insoles.map(|insole| insole.load(values))),
        }
    }
}

const ALL_BUT_VERTICAL: u32 = Component::Shear as u32 | Component::Tilt as u32 | Component::FreeMoment as u32;

fn part(wrench: Wrench, not_measured: u32) -> Load {
    if not_measured == 0 { Load::Wrench(wrench) } else { Load::Part { wrench, not_measured } }
}

impl Insole {
    fn load(self, values: &[f64]) -> FootLoad {
        let vertical_n = value(values, Some(self.vertical)) * self.newtons_per_unit;
        let [x, y] =
            core::array::from_fn(|axis| value(values, Some(self.cop[axis])) * self.metres_per_unit[axis]);
        // The centre of an unloaded foot is noise. A NaN force is kept, so that the receiver refuses it.
        let cop_m = if vertical_n <= 0.0 { [0.0; 2] } else { [x, y] };
        FootLoad { vertical_n, cop_m }
    }
}

impl Centre {
    fn wrench(&self, values: &[f64]) -> Wrench {
        let newtons = |channel| value(values, channel) * self.newtons_per_unit;
        let (fx, fy) = (newtons(self.shear.map(|[x, _]| x)), newtons(self.shear.map(|[_, y]| y)));
        let fz = newtons(Some(self.vertical));
        let [x, y] = self.cop.map(|channel| value(values, Some(channel)) * self.metres_per_unit);
        let z = self.surface_z_m;
        let free_nm = value(values, self.free_moment) * self.newton_metres_per_unit;
        Wrench {
            force_n: [fx, fy, fz],
            moment_nm: [y * fz - z * fy, z * fx - x * fz, x * fy - y * fx + free_nm],
        }
    }
}

/// Why a configuration of channels is invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ChannelFault {
    /// A channel that does not exist.
    #[error("channel {channel} is asked for, and there are {count}, counted from 0")]
    Beyond {
        /// Counted from 0.
        channel: usize,
        /// Count of channels.
        count: usize,
    },
    /// One channel of a pair (x, y) without the other.
    #[error("{what}: one of the two without the other says nothing; name both or neither")]
    Half {
        /// The two channels.
        what: &'static str,
    },
    /// A matrix that does not have six rows with one number for each channel.
    #[error("row {row} of the matrix has {got} numbers, and there are {want} channels")]
    Row {
        /// Counted from 1.
        row: usize,
        /// Actual count.
        got: usize,
        /// Expected count.
        want: usize,
    },
    /// A number that is not finite, or a zero divisor.
    #[error("{what} must be a finite number, and not zero")]
    Number {
        /// The number.
        what: &'static str,
    },
    /// Load cells that do not support a plate.
    #[error("a plate needs three load cells or more that do not stand in one line")]
    Cells,
}

#[cfg(test)]
mod tests;
