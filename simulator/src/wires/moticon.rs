//! Moticon OpenGo over UDP: one datagram per sample, decimals separated by spaces, and no header.
//!
//! After four public receivers. The user selects the fields and their order.

use core::fmt::Write;

/// Data of one insole.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Insole {
    /// Acceleration, g.
    pub acceleration_g: [f64; 3],
    /// Angular velocity, °/s.
    pub turning_deg_per_s: [f64; 3],
    /// Centre of pressure from the middle, as fractions of the insole's length (to the tip) and width.
    pub cop: [f64; 2],
    /// Sixteen cells, N/cm².
    pub pressure: [f64; 16],
    /// Total force, N.
    pub force_n: f64,
}

/// A channel that the user may select, for one or both feet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Three of acceleration.
    Acceleration,
    /// Three of angular velocity.
    Turning,
    /// Two of the centre of pressure.
    Cop,
    /// Sixteen cells.
    Pressure,
    /// One of force.
    Force,
}

/// All channels, in the order of the full selection of 51 fields.
pub const ALL: [Channel; 5] =
    [Channel::Acceleration, Channel::Turning, Channel::Cop, Channel::Pressure, Channel::Force];

/// Number of decimals of a channel.
fn written(insole: &Insole, channel: Channel) -> (usize, Vec<f64>) {
    match channel {
        Channel::Acceleration => (2, insole.acceleration_g.to_vec()),
        Channel::Turning => (1, insole.turning_deg_per_s.to_vec()),
        // A thousandth of a foot's length is a quarter of a millimetre.
        Channel::Cop => (4, insole.cop.to_vec()),
        Channel::Pressure => (2, insole.pressure.to_vec()),
        Channel::Force => (1, vec![insole.force_n]),
    }
}

/// A datagram: the device's seconds, then the left foot's channels, then the right foot's.
pub fn datagram(time_s: f64, feet: &[Insole; 2], channels: &[Channel]) -> String {
    let mut text = format!("{time_s:.3}");
    for insole in feet {
        for (decimals, values) in channels.iter().map(|channel| written(insole, *channel)) {
            for value in values {
                // Writing into a string cannot fail.
                let _ = write!(text, " {value:.decimals$}");
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_full_selection_has_51_fields_and_another_fewer() {
        let feet = [Insole { force_n: 350.0, cop: [-0.1, 0.02], ..Insole::default() }, Insole::default()];
        let fields = |channels: &[Channel]| {
            datagram(12.34, &feet, channels).split(' ').map(str::to_owned).collect::<Vec<_>>()
        };
        let full = fields(&ALL);
        assert_eq!(full.len(), 51);
        assert_eq!((full[0].as_str(), full[7].as_str(), full[25].as_str()), ("12.340", "-0.1000", "350.0"));
        assert_eq!(fields(&[Channel::Pressure]).len(), 33);
        assert_eq!(fields(&[Channel::Force, Channel::Cop])[1..4], ["350.0", "-0.1000", "0.0200"]);
    }
}
