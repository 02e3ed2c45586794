//! The one simulated human on all devices: standing, swaying, pushing against an object.

use std::sync::Arc;

use equipoise_simulator::devices::load::OnFeet;
use equipoise_simulator::dynamics::Wrench;
use equipoise_simulator::motion::{Habits, Worker};
use equipoise_simulator::noise::{Suit, SuitNoise};
use equipoise_simulator::suit_sender::{Streams, SuitWorld, frame_at};
use equipoise_simulator::wire::SuitFrame;
use nalgebra::{Vector2, Vector3};

/// Period of the person's motion, s …
const SPAN_S: f64 = 60.0;
/// … sampled at this rate and interpolated linearly.
const INSTANTS_HZ: f64 = 50.0;
/// Pressure point of each foot, from its ankle, m.
const PRESS_M: [Vector2<f64>; 2] = [Vector2::new(0.05, 0.004), Vector2::new(0.035, -0.006)];
/// External horizontal force of the push: shear on each foot, N, and a free moment, N m.
const LEAN_N: [f64; 3] = [24.0, -11.0, 0.0];
const TURN_NM: f64 = 4.0;

/// The simulated human and the load on its feet.
pub(crate) struct Person {
    worker: Worker,
    suit: Suit,
    on_feet: Vec<OnFeet>,
}

impl Person {
    pub(crate) fn new() -> Person {
        let body = equipoise_simulator::person::Person::new(7, 1.77, 72.0);
        let worker = Worker::with_habits(body, 7, Habits::ORDINARY);
        let count = (SPAN_S * INSTANTS_HZ) as usize + 1;
        let on_feet = (0..count)
            .map(|instant| {
                let mut feet = OnFeet::of(&worker, 1.0 + instant as f64 / INSTANTS_HZ, PRESS_M);
                for wrench in &mut feet.wrench {
                    let at = wrench.cop_m().push(0.0);
                    let lean = Wrench::at(at, Vector3::from(LEAN_N));
                    wrench.force_n += lean.force_n;
                    wrench.moment_nm += lean.moment_nm + Vector3::z() * TURN_NM;
                }
                feet
            })
            .collect();
        Person { worker, suit: Suit::new(SuitNoise::NONE, 7), on_feet }
    }

    /// Maps a time into the motion, played forwards and backwards, so that it is continuous.
    fn folded_s(time_s: f64) -> f64 {
        let folded = time_s.rem_euclid(2.0 * SPAN_S);
        folded.min(2.0 * SPAN_S - folded)
    }

    /// Load on the feet at a time.
    pub(crate) fn on_feet(&self, time_s: f64) -> OnFeet {
        let place = Person::folded_s(time_s) * INSTANTS_HZ;
        let (index, fraction) = ((place as usize).min(self.on_feet.len() - 2), place.fract());
        let (a, b) = (&self.on_feet[index], &self.on_feet[index + 1]);
        let mix = |k: usize| Wrench {
            force_n: a.wrench[k].force_n.lerp(&b.wrench[k].force_n, fraction),
            moment_nm: a.wrench[k].moment_nm.lerp(&b.wrench[k].moment_nm, fraction),
        };
        // The soles change too little within a fiftieth of a second to require interpolation.
        OnFeet { wrench: [mix(0), mix(1)], soles: a.soles }
    }

    /// The same for a device.
    pub(crate) fn load(self: &Arc<Person>) -> equipoise_simulator::devices::running::Load {
        let person = Arc::clone(self);
        Arc::new(move |time_s| person.on_feet(time_s))
    }

    /// Frame of a suit without error.
    pub(crate) fn suit_frame(
        &self,
        streams: Streams,
        time_s: f64,
        counter: u32,
        device_ms: u32,
    ) -> SuitFrame {
        let time_s = 1.0 + Person::folded_s(time_s);
        let world = SuitWorld::default();
        frame_at(&self.worker, &self.suit, world, streams, 0, time_s, (counter, device_ms))
    }

    /// Identity and calibration datagrams of MVN.
    pub(crate) fn introduction(&self) -> Vec<Vec<u8>> {
        equipoise_simulator::wire::introduction(self.worker.person(), 0).unwrap()
    }

    /// Length and width of its soles, m.
    pub(crate) fn sole_size_m(&self) -> [f64; 2] {
        self.on_feet[0].soles[0].size_m
    }
}
