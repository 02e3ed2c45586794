//! How a person's feet divide the ground reaction, beyond what balance determines.
//!
//! Balance gives the force of both feet together and its point of action: three of the six unknowns of two vertical
//! forces and their points. The other three are drawn here, with the load and, independently, for the same motion without
//! it; and so is the division of the horizontal force and of the moment about the vertical.

use crate::random::{BandLimitedNoise, Random};

/// Frequencies of the drawn quantities: from minutes of standing to a few poses of work, Hz.
pub(crate) const DRAWN_HZ: [f64; 2] = [0.01, 0.3];

/// Mass of the load at which [`FeetChange`] is as drawn, kg: the box of the recordings.
pub const CHANGE_AT_KG: f64 = 11.3;

/// Standard deviations of the drawn quantities. All zero: both feet press at the same offset from their ankles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeetHabits {
    /// Of [`FeetDivision::ahead_m`], m.
    pub ahead_m: f64,
    /// Of each foot's [`FeetDivision::aside_m`], m.
    pub aside_m: f64,
    /// Of [`FeetDivision::change`].
    pub change: FeetChange,
    /// Of [`FeetDivision::shear`] and [`FeetDivision::free_moment`], each.
    pub shear: f64,
}

impl FeetHabits {
    /// No deviation.
    pub const EVEN: FeetHabits =
        FeetHabits { ahead_m: 0.0, aside_m: 0.0, change: FeetChange::NONE, shear: 0.0 };
}

/// What a load of [`CHANGE_AT_KG`] changes under the feet, beyond what balance determines: the division without the load
/// less that with it. Proportional to the load, because without one both are the same motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeetChange {
    /// Of the left foot's fraction of the vertical force, while both carry the same.
    pub fraction: f64,
    /// Of [`FeetDivision::ahead_m`], m.
    pub ahead_m: f64,
    /// Of the distance of the left foot's pressure point to the left, m; the right foot's is opposite.
    pub aside_m: f64,
}

impl FeetChange {
    /// None.
    pub const NONE: FeetChange = FeetChange { fraction: 0.0, ahead_m: 0.0, aside_m: 0.0 };

    /// The change by a load of this mass.
    #[must_use]
    pub fn by(self, load_kg: f64) -> FeetChange {
        let factor = load_kg / CHANGE_AT_KG;
        FeetChange {
            fraction: factor * self.fraction,
            ahead_m: factor * self.ahead_m,
            aside_m: factor * self.aside_m,
        }
    }
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
    /// What the load changes.
    pub change: FeetChange,
    /// The left foot's fraction of the horizontal force less that of the vertical one, while both carry the same.
    pub shear: f64,
    /// The same of the moment about the vertical that these forces leave.
    pub free_moment: f64,
}

impl FeetDivision {
    /// No deviation.
    pub const EVEN: FeetDivision = FeetDivision {
        ahead_m: 0.0,
        aside_m: [0.0; 2],
        change: FeetChange::NONE,
        shear: 0.0,
        free_moment: 0.0,
    };
}

/// The drawn quantities as functions of time, independent of each other.
#[derive(Debug, Clone)]
pub struct Feet {
    ahead_m: BandLimitedNoise,
    aside_m: [BandLimitedNoise; 2],
    change_fraction: BandLimitedNoise,
    change_ahead_m: BandLimitedNoise,
    change_aside_m: BandLimitedNoise,
    shear: BandLimitedNoise,
    free_moment: BandLimitedNoise,
}

impl Feet {
    /// The feet of the person with this seed.
    pub fn new(habits: &FeetHabits, seed: u64) -> Feet {
        let mut random = Random::new(seed, "foot press");
        let mut drawn = |sigma: f64| BandLimitedNoise::new(&mut random, sigma, DRAWN_HZ[0], DRAWN_HZ[1]);
        Feet {
            ahead_m: drawn(habits.ahead_m),
            aside_m: std::array::from_fn(|_| drawn(habits.aside_m)),
            change_fraction: drawn(habits.change.fraction),
            change_ahead_m: drawn(habits.change.ahead_m),
            change_aside_m: drawn(habits.change.aside_m),
            shear: drawn(habits.shear),
            free_moment: drawn(habits.shear),
        }
    }

    /// The quantities at a time.
    pub fn at(&self, time_s: f64) -> FeetDivision {
        FeetDivision {
            ahead_m: self.ahead_m.at(time_s),
            aside_m: self.aside_m.each_ref().map(|aside_m| aside_m.at(time_s)),
            change: FeetChange {
                fraction: self.change_fraction.at(time_s),
                ahead_m: self.change_ahead_m.at(time_s),
                aside_m: self.change_aside_m.at(time_s),
            },
            shear: self.shear.at(time_s),
            free_moment: self.free_moment.at(time_s),
        }
    }
}
