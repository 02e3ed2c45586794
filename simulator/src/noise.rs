//! What the sensors add to the truth: a suit's misalignment and drift, a plate's noise.

use equipoise_core::body::{SEGMENTS, Side};
use nalgebra::{UnitQuaternion, Vector3};

use crate::colour::SuitColour;
use crate::dynamics::Wrench;
use crate::kinematics::{Rotations, origins_m};
use crate::motion::BodyState;
use crate::person::Person;
use crate::random::{Random, Wander};

/// How good a suit is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuitNoise {
    /// Standard deviation per axis of each segment's constant misalignment, rad.
    pub misalignment_rad: f64,
    /// Standard deviation per axis of each segment's slow wander, rad.
    pub wander_rad: f64,
    /// Standard deviation per axis of the slow drift of the whole body's position, m.
    pub drift_m: [f64; 3],
}

impl SuitNoise {
    /// About 0.7° per axis, centimetres of drift over minutes.
    pub const ORDINARY: SuitNoise =
        SuitNoise { misalignment_rad: 0.010, wander_rad: 0.005, drift_m: [0.03, 0.03, 0.005] };
    /// A suit without error.
    pub const NONE: SuitNoise = SuitNoise { misalignment_rad: 0.0, wander_rad: 0.0, drift_m: [0.0; 3] };
}

/// What a suit with errors sees of a body.
#[derive(Debug, Clone)]
pub struct Suit {
    misalignment: Rotations,
    wander: [[Wander; 3]; SEGMENTS],
    drift: [Wander; 3],
    colour: Option<SuitColour>,
}

impl Suit {
    /// A suit with the errors of a seed.
    pub fn new(noise: SuitNoise, seed: u64) -> Suit {
        let mut random = Random::new(seed, "suit");
        let misalignment = std::array::from_fn(|_| {
            UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| {
                noise.misalignment_rad * random.normal()
            }))
        });
        let wander = std::array::from_fn(|_| {
            std::array::from_fn(|_| Wander::new(&mut random, noise.wander_rad, 0.005, 0.05))
        });
        let drift = noise.drift_m.map(|sigma| Wander::new(&mut random, sigma, 0.001, 0.01));
        Suit { misalignment, wander, drift, colour: None }
    }

    /// The same with errors that go with pose and time.
    #[must_use]
    pub fn with_colour(self, colour: SuitColour) -> Suit {
        Suit { colour: Some(colour), ..self }
    }

    /// Segment origins (m) and `world_from_segment` as the suit reports them.
    ///
    /// A suit computes positions from its own orientations along the segments, and ties the feet to the floor; so do
    /// we, with the true lengths.
    pub fn see(&self, person: &Person, body: &BodyState) -> ([Vector3<f64>; SEGMENTS], Rotations) {
        let t = body.time_s;
        let seen: Rotations = std::array::from_fn(|i| {
            let wander = Vector3::from_fn(|axis, _| self.wander[i][axis].at(t));
            body.world_from_segment[i] * UnitQuaternion::from_scaled_axis(wander) * self.misalignment[i]
        });
        let seen = match &self.colour {
            Some(colour) => colour.on(seen, body),
            None => seen,
        };
        self.place(person, body, seen)
    }

    /// Positions for rotations that the suit believes.
    pub fn place(
        &self,
        person: &Person,
        body: &BodyState,
        seen: Rotations,
    ) -> ([Vector3<f64>; SEGMENTS], Rotations) {
        let t = body.time_s;
        let hanging = origins_m(person, Vector3::zeros(), &seen);
        let feet = |origin: &[Vector3<f64>; SEGMENTS]| {
            Side::BOTH.map(|side| origin[side.foot().index()]).iter().sum::<Vector3<f64>>() * 0.5
        };
        let drift = Vector3::from_fn(|axis, _| self.drift[axis].at(t));
        let shift = feet(&body.origin_m) - feet(&hanging) + drift;
        (hanging.map(|origin| origin + shift), seen)
    }
}

/// How good a plate is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateNoise {
    /// Standard deviation of each force component, white, N.
    pub force_n: f64,
    /// Standard deviation of each moment component about the sensor's origin, white, N m.
    pub moment_nm: f64,
}

impl PlateNoise {
    /// A good plate.
    pub const ORDINARY: PlateNoise = PlateNoise { force_n: 1.0, moment_nm: 0.3 };
    /// A plate without error.
    pub const NONE: PlateNoise = PlateNoise { force_n: 0.0, moment_nm: 0.0 };

    /// A wrench with the noise of one more sample.
    #[must_use]
    pub fn on(&self, wrench: Wrench, random: &mut Random) -> Wrench {
        let mut white = |sigma: f64| Vector3::from_fn(|_, _| sigma * random.normal());
        Wrench {
            force_n: wrench.force_n + white(self.force_n),
            moment_nm: wrench.moment_nm + white(self.moment_nm),
        }
    }
}
