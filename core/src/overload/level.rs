//! Level of an overload torque: the colours of Table I, with hysteresis, and only as far as σ allows.
//!
//! # The rule
//!
//! For a torque t ± σ at a joint with the limit τ_max and the previous level H:
//!
//! 1. If t − σ and t + σ lie two or more levels apart, the level is [`Level::Undecided`].
//! 2. H is left upwards as soon as t passes its upper bound. It is left downwards only when t falls below its lower
//!    bound by the margin, the larger of `margin_fraction · τ_max` and σ/2.
//! 3. If H was left, or there is no H, the level is that of t in Table I, provided that t − σ and t + σ have the same
//!    level or that H is the level of one of them; else it is undecided. An undecided joint holds no level.
//!
//! So a torque that varies by less than the margin changes the level at most once; without σ and margin the level is
//! that of Table I; and a joint without a previous level has none until ±σ fits into one level. A withheld torque holds
//! no level.

use bytemuck::{Pod, Zeroable};

use crate::body::JOINTS;

/// Overload level of a joint (Fortini et al., Table I; the level above τ_max is an extension).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Level {
    /// No value: the torque is invalid.
    None = 0,
    /// Up to 0.3 τ_max.
    Green = 1,
    /// Up to 0.6 τ_max.
    Orange = 2,
    /// Up to τ_max.
    Red = 3,
    /// Beyond τ_max.
    AboveMax = 4,
    /// The torque is valid, but its σ covers two levels.
    Undecided = 5,
}

/// Upper bounds of green, orange and red over τ_max (Table I).
const BOUNDS: [f64; 3] = [0.3, 0.6, 1.0];

impl Level {
    /// The level of a torque's magnitude against the joint's limit, both N m: Table I.
    pub fn of(torque_nm: f64, limit_nm: f64) -> Level {
        let limit_ratio = torque_nm / limit_nm;
        if limit_ratio <= BOUNDS[0] {
            Level::Green
        } else if limit_ratio <= BOUNDS[1] {
            Level::Orange
        } else if limit_ratio <= BOUNDS[2] {
            Level::Red
        } else {
            Level::AboveMax
        }
    }

    /// Lower bound of a level of the table, over τ_max; `None` if there is no level.
    fn lower_bound(self) -> Option<f64> {
        match self {
            Level::None | Level::Undecided => None,
            Level::Green => Some(f64::NEG_INFINITY),
            Level::Orange => Some(BOUNDS[0]),
            Level::Red => Some(BOUNDS[1]),
            Level::AboveMax => Some(BOUNDS[2]),
        }
    }

    /// The level that follows `self` for a torque's magnitude and its σ, given the joint's limit, all N m, by the rule
    /// above. `margin_fraction` is a fraction of the limit.
    #[must_use]
    pub fn after(self, torque_nm: f64, sigma_nm: f64, limit_nm: f64, margin_fraction: f64) -> Level {
        let [low, own, high] =
            [torque_nm - sigma_nm, torque_nm, torque_nm + sigma_nm].map(|nm| Level::of(nm, limit_nm));
        if high as u32 - low as u32 > 1 {
            return Level::Undecided;
        }
        let margin_nm = (margin_fraction * limit_nm).max(0.5 * sigma_nm);
        match self.lower_bound() {
            Some(bound) if own < self && torque_nm > bound * limit_nm - margin_nm => self,
            Some(_) if low <= self && self <= high => own,
            _ if low == high => own,
            _ => Level::Undecided,
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

/// The last published level of every joint.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Levels {
    /// Numbers of [`Level`]; 0 if none is held.
    held: [u64; JOINTS],
}

impl Levels {
    /// Computes and stores the next level of a joint.
    pub fn next(
        &mut self,
        joint: usize,
        torque_nm: f64,
        sigma_nm: f64,
        limit_nm: f64,
        margin_fraction: f64,
    ) -> Level {
        let held = Level::from_number(self.held[joint] as u32).unwrap_or(Level::None);
        let level = held.after(torque_nm, sigma_nm, limit_nm, margin_fraction);
        self.held[joint] = level as u64;
        level
    }

    /// Clears all levels: the torques are withheld.
    pub fn reset(&mut self) {
        self.held = [Level::None as u64; JOINTS];
    }

    /// Whether every number is that of a level.
    pub fn is_sound(&self) -> bool {
        self.held.iter().all(|&held| held <= Level::Undecided as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: [Level; 4] = [Level::Green, Level::Orange, Level::Red, Level::AboveMax];

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
    fn a_torque_without_sigma_has_the_level_of_table_1() {
        for tenth in 0..1200 {
            let torque = f64::from(tenth) * 0.1;
            let own = Level::of(torque, 100.0);
            for held in [Level::None, Level::Undecided] {
                assert_eq!(held.after(torque, 0.0, 100.0, 0.02), own);
            }
            for held in TABLE {
                assert_eq!(held.after(torque, 0.0, 100.0, 0.0), own, "without a margin");
                assert!(held.after(torque, 0.0, 100.0, 0.02) >= own, "the margin never masks an overload");
            }
        }
    }

    #[test]
    fn a_swing_below_the_margin_changes_the_level_at_most_once() {
        for sigma in [0.0, 0.5, 3.0, 10.0] {
            let swing = 0.99 * f64::max(2.0, 0.5 * sigma);
            for middle in 0..240 {
                let middle = f64::from(middle) * 0.5;
                let mut levels: Levels = Zeroable::zeroed();
                let mut changes = 0;
                let mut before = Level::None;
                for step in 0..40 {
                    let torque = middle + if step % 2 == 0 { -0.5 } else { 0.5 } * swing;
                    let level = levels.next(0, torque, sigma, 100.0, 0.02);
                    changes += u32::from(step > 0 && level != before);
                    before = level;
                }
                assert!(changes <= 1, "{changes} changes around {middle} ± {sigma}");
            }
        }
    }

    #[test]
    fn a_level_is_left_upwards_at_once_and_downwards_by_the_margin() {
        let next = |held: Level, torque| held.after(torque, 1.0, 100.0, 0.02);
        assert_eq!(next(Level::Green, 30.1), Level::Orange);
        assert_eq!(next(Level::Orange, 28.1), Level::Orange);
        assert_eq!(next(Level::Orange, 27.9), Level::Green);
        assert_eq!(next(Level::AboveMax, 10.0), Level::Green, "far below there is nothing to hold");
    }

    #[test]
    fn a_torque_with_a_large_sigma_is_undecided() {
        assert_eq!(Level::None.after(29.0, 2.0, 100.0, 0.02), Level::Undecided);
        assert_eq!(Level::Green.after(29.0, 2.0, 100.0, 0.02), Level::Green, "a held level within ±σ stays");
        assert_eq!(Level::Undecided.after(27.9, 2.0, 100.0, 0.02), Level::Green);
        assert_eq!(Level::Green.after(61.0, 2.0, 100.0, 0.02), Level::Undecided, "green is out of reach");
        for held in TABLE {
            assert_eq!(held.after(45.0, 20.0, 100.0, 0.02), Level::Undecided, "three levels wide");
        }
    }

    #[test]
    fn a_level_survives_a_round_trip() {
        for held in TABLE {
            for torque in 0..130 {
                for sigma in [0.0, 1.0, 5.0, 12.0, 40.0] {
                    let once = held.after(f64::from(torque), sigma, 100.0, 0.02);
                    assert_eq!(once.after(f64::from(torque), sigma, 100.0, 0.02), once);
                }
            }
        }
    }
}
