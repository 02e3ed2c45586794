//! How bad an overload is: the colours of Table I, and what each joint is allowed.

use crate::body::{JOINTS, Joint};

/// Overload level of a joint (Fortini et al., Table I; above τ_max is ours).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Level {
    /// No value: something spoils the torque.
    None = 0,
    /// Up to 0.3 τ_max.
    Green = 1,
    /// Up to 0.6 τ_max.
    Orange = 2,
    /// Up to τ_max.
    Red = 3,
    /// Beyond τ_max.
    AboveMax = 4,
    /// The torque is known, but not well enough to say which of two levels it has.
    Undecided = 5,
}

impl Level {
    /// The level of a torque's magnitude against the joint's limit, both N m.
    pub fn of(torque_nm: f64, limit_nm: f64) -> Level {
        let share = torque_nm / limit_nm;
        if share <= 0.3 {
            Level::Green
        } else if share <= 0.6 {
            Level::Orange
        } else if share <= 1.0 {
            Level::Red
        } else {
            Level::AboveMax
        }
    }

    /// The level of a message's number, `None` for a number of a later version.
    pub fn from_number(number: u32) -> Option<Level> {
        [Level::None, Level::Green, Level::Orange, Level::Red, Level::AboveMax, Level::Undecided]
            .into_iter()
            .nth(number as usize)
    }

    /// The public name.
    pub fn name(self) -> &'static str {
        match self {
            Level::None => "none",
            Level::Green => "green",
            Level::Orange => "orange",
            Level::Red => "red",
            Level::AboveMax => "above_max",
            Level::Undecided => "undecided",
        }
    }
}

/// τ_max of every joint, N m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorqueLimits(pub [f64; JOINTS]);

/// Defaults for both sides. The paper finds τ_max per subject by experiment and publishes no numbers; these are
/// round figures in the range of one- and two-handed lifting strength, to be replaced in the subject's
/// configuration. They set colours only: no torque depends on them.
const DEFAULT_NM: [(&str, f64); 12] = [
    ("L5S1", 120.0),
    ("L4L3", 120.0),
    ("L1T12", 110.0),
    ("T9T8", 100.0),
    ("Shoulder", 40.0),
    ("Elbow", 35.0),
    ("Wrist", 12.0),
    ("Hip", 90.0),
    ("Knee", 80.0),
    ("Ankle", 70.0),
    ("BallFoot", 30.0),
    ("T4Shoulder", 60.0),
];
/// Neck joints carry nothing from the hands.
const OTHERWISE_NM: f64 = 30.0;

impl Default for TorqueLimits {
    fn default() -> Self {
        TorqueLimits(Joint::ALL.map(|joint| {
            let name = joint.name();
            let name = name.strip_prefix("Left").or_else(|| name.strip_prefix("Right")).unwrap_or(name);
            DEFAULT_NM.iter().find(|(default, _)| *default == name).map_or(OTHERWISE_NM, |(_, limit)| *limit)
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bounds_are_those_of_table_1() {
        for (torque, level) in [
            (0.0, Level::Green),
            (30.0, Level::Green),
            (30.1, Level::Orange),
            (60.0, Level::Orange),
            (99.0, Level::Red),
            (100.1, Level::AboveMax),
        ] {
            assert_eq!(Level::of(torque, 100.0), level, "{torque}");
        }
    }

    #[test]
    fn both_sides_have_the_same_limits() {
        let limits = TorqueLimits::default();
        for joint in Joint::ALL {
            let mirrored = joint.segment().mirrored().proximal_joint().unwrap();
            assert_eq!(limits.0[joint.index()], limits.0[mirrored.index()]);
        }
        assert_eq!(limits.0[Joint::named("LeftT4Shoulder").unwrap().index()], 60.0);
    }
}
