//! A worker with all deviations of body, suit and plate, as measured by one station: for studies.

use equipoise_core::body::SEGMENTS;
use nalgebra::Vector3;

use crate::burden::{BodyChange, Burden, Span, SuitFault};
use crate::colour::PlateColour;
use crate::dynamics::{Wrench, ground_reaction};
use crate::kinematics::Rotations;
use crate::motion::{BodyState, DIFFERENCE_S, Worker};
use crate::noise::{PlateNoise, Suit};
use crate::plate_fault::{FaultyPlate, PlateFault};
use crate::random::Random;

/// Hidden deviations of a scene, each with its time span.
#[derive(Debug, Clone, Default)]
pub struct Hidden {
    /// External masses and forces.
    pub burdens: Vec<(Burden, Span)>,
    /// Changes of the body.
    pub changes: Vec<(BodyChange, Span)>,
    /// Faults of the suit.
    pub suit: Vec<(SuitFault, Span)>,
    /// Lags of the suit, s.
    pub suit_lag_s: Vec<(f64, Span)>,
    /// Faults of the plate.
    pub plate: Vec<(PlateFault, Span)>,
}

/// A worker, a suit, and their hidden deviations.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The worker.
    pub worker: Worker,
    /// The suit.
    pub suit: Suit,
    /// Deviations that are not reported to the estimator.
    pub hidden: Hidden,
}

impl Scene {
    /// True state of the body.
    pub fn body(&self, time_s: f64) -> BodyState {
        self.changed(self.worker.sample(time_s))
    }

    fn changed(&self, mut body: BodyState) -> BodyState {
        let time_s = body.time_s;
        for (change, span) in &self.hidden.changes {
            change.on(&mut body, span.activation(time_s));
        }
        body
    }

    /// True ground reaction on the person, about the world's origin.
    pub fn ground_reaction(&self, time_s: f64) -> Wrench {
        let around = self.worker.around(time_s).map(|body| self.changed(body));
        let mut wrench = ground_reaction(self.worker.person(), &around, DIFFERENCE_S);
        for (burden, span) in &self.hidden.burdens {
            let activation = span.activation(time_s);
            if activation != 0.0 {
                let more = burden.ground_reaction(&around, DIFFERENCE_S);
                wrench.force_n += more.force_n * activation;
                wrench.moment_nm += more.moment_nm * activation;
            }
        }
        wrench
    }

    /// Segment origins (m) and rotations as the suit reports them for a time.
    pub fn seen(&self, time_s: f64) -> ([Vector3<f64>; SEGMENTS], Rotations) {
        let late_s: f64 =
            self.hidden.suit_lag_s.iter().map(|(lag_s, span)| lag_s * span.activation(time_s)).sum();
        let body = self.body(time_s - late_s);
        let (origin_m, mut rotation) = self.suit.see(self.worker.person(), &body);
        if self.hidden.suit.is_empty() {
            return (origin_m, rotation);
        }
        for (fault, span) in &self.hidden.suit {
            fault.on(&mut rotation, &body, span.activation(time_s), time_s - span.from_s);
        }
        self.suit.place(self.worker.person(), &body, rotation)
    }
}

/// A plate with all its faults: evaluated sample by sample, in order.
#[derive(Debug, Clone)]
pub struct SensedPlate {
    faulty: FaultyPlate,
    colour: PlateColour,
    noise: PlateNoise,
    seed: u64,
}

impl SensedPlate {
    /// A plate under a scene.
    pub fn new(hidden: &Hidden, colour: PlateColour, noise: PlateNoise, seed: u64) -> SensedPlate {
        SensedPlate { faulty: FaultyPlate::new(hidden.plate.clone()), colour, noise, seed }
    }

    /// Output for a wrench on the person, without noise.
    pub fn faulty(&mut self, on_person: Wrench, time_s: f64) -> Wrench {
        self.faulty.feel(on_person, time_s)
    }

    /// The same with noise, which is independent of the hidden deviations.
    pub fn noisy(&self, faulty: Wrench, time_s: f64, number: u32) -> Wrench {
        let mut random = Random::numbered(self.seed, "plate noise", number);
        self.noise.on(self.colour.on(faulty, time_s), &mut random)
    }
}
