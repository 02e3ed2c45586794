//! How a person's feet divide the ground reaction, beyond what balance determines.
//!
//! Balance gives the force of both feet together and its point of action: three of the six unknowns of two vertical
//! forces and their points. The other three are drawn here.

use crate::random::{Random, Wander};

/// Frequencies of the drawn quantities: from minutes of standing to a few poses of work, Hz.
const DRAWN_HZ: [f64; 2] = [0.01, 0.3];

/// Standard deviations of the drawn quantities. All zero: both feet press at the same offset from their ankles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeetHabits {
    /// Of [`FeetDivision::ahead_m`], m.
    pub ahead_m: f64,
    /// Of each foot's [`FeetDivision::aside_m`], m.
    pub aside_m: f64,
}

impl FeetHabits {
    /// No deviation.
    pub const EVEN: FeetHabits = FeetHabits { ahead_m: 0.0, aside_m: 0.0 };
}

/// The drawn quantities at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeetDivision {
    /// Distance of the left foot's pressure point ahead of the line common to both feet, while both carry the same
    /// force, m; the right foot's is opposite. The common line is parallel to that between the ankles and contains the
    /// centre of pressure.
    pub ahead_m: f64,
    /// Distance of each foot's pressure point to the left of its ankle, foot's axes, m.
    pub aside_m: [f64; 2],
}

impl FeetDivision {
    /// No deviation.
    pub const EVEN: FeetDivision = FeetDivision { ahead_m: 0.0, aside_m: [0.0; 2] };
}

/// The drawn quantities as functions of time, independent of each other.
#[derive(Debug, Clone)]
pub struct Feet {
    ahead_m: Wander,
    aside_m: [Wander; 2],
}

impl Feet {
    /// The feet of the person with this seed.
    pub fn new(habits: &FeetHabits, seed: u64) -> Feet {
        let mut random = Random::new(seed, "foot press");
        let mut drawn = |sigma: f64| Wander::new(&mut random, sigma, DRAWN_HZ[0], DRAWN_HZ[1]);
        Feet { ahead_m: drawn(habits.ahead_m), aside_m: std::array::from_fn(|_| drawn(habits.aside_m)) }
    }

    /// The quantities at a time.
    pub fn at(&self, time_s: f64) -> FeetDivision {
        FeetDivision {
            ahead_m: self.ahead_m.at(time_s),
            aside_m: self.aside_m.each_ref().map(|aside_m| aside_m.at(time_s)),
        }
    }
}
