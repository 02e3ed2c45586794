//! The plates' threads: one plate under both feet, or one under each.

use std::f64::consts::TAU;
use std::io;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::{Vector2, Vector3};

use super::Shared;
use crate::GRAVITY_M_PER_S2;
use crate::dynamics::Wrench;
use crate::plate::Plate;
use crate::plate_server::{PlateServer, Request};
use crate::random::Random;
use crate::two_plates::{PLATE_NOISE, ground_reaction_per_foot};

/// Load of the plates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OnPlates {
    /// The worker.
    Worker,
    /// Unloaded.
    Nothing,
    /// A dead weight, with the point that its centre of mass is above, m.
    Mass {
        /// kg.
        mass_kg: f64,
        /// World x and y, m.
        at_m: [f64; 2],
    },
    /// A pointed rod pressed on a point and tilted around it by a person.
    Rod {
        /// Vertical force, N.
        press_n: f64,
        /// Horizontal force, which rotates once in 4 s, N.
        lean_n: f64,
        /// World x and y, m.
        at_m: [f64; 2],
    },
}

impl OnPlates {
    /// Wrench of the plate on the object at a time.
    fn wrench(self, worker: impl FnOnce() -> Wrench, time_s: f64) -> Wrench {
        let at = |[x, y]: [f64; 2], force_n: Vector3<f64>| Wrench::at(Vector3::new(x, y, 0.0), force_n);
        match self {
            OnPlates::Worker => worker(),
            OnPlates::Nothing => at([0.0; 2], Vector3::zeros()),
            OnPlates::Mass { mass_kg, at_m } => at(at_m, Vector3::z() * (mass_kg * GRAVITY_M_PER_S2)),
            OnPlates::Rod { press_n, lean_n, at_m } => {
                let (sin, cos) = (TAU * time_s / 4.0).sin_cos();
                at(at_m, Vector3::new(lean_n * cos, lean_n * sin, press_n))
            }
        }
    }
}

impl Shared {
    /// Serves the first plate (0) or the second until the stop flag is set.
    pub(super) fn run_plate(
        &self,
        mut server: PlateServer,
        which: usize,
        stop: &AtomicBool,
    ) -> io::Result<()> {
        let settings = &self.settings.plate;
        let (plate, rate_hz) = self.plate(which);
        let mut bias = Wrench { force_n: Vector3::zeros(), moment_nm: Vector3::zeros() };
        let mut reset_s = 0.0;
        let mut before = self.faults();
        let mut number = 0_u32;
        self.pace(stop, 1, (rate_hz, settings.latency_s), |clock| {
            let faults = self.faults();
            if faults.restarts[1] != before.restarts[1] {
                clock.restart();
                server.restart();
            }
            before = faults;
            number = number.wrapping_add(1);
            let request = server.poll();
            if !server.has_client() && request.is_none() {
                return Ok(rate_hz);
            }
            let time_s = clock.time_s();
            let wrench = plate.sensor_wrench(&plate.in_the_station(&self.pressed(which, time_s)));
            // Each sample has independent noise, whether or not those before it were requested.
            let mut random = Random::numbered(self.settings.seed, PLATE_NOISE[which], number - 1);
            let mut wrench = settings.noise.on(wrench, &mut random);
            if request == Some(Request::SetBias) {
                (bias, reset_s) = (wrench, time_s);
            }
            let drift = settings.zero.at(time_s - reset_s);
            wrench.force_n += drift.force_n;
            wrench.moment_nm += drift.moment_nm;
            if self.plate_silent[which].load(Ordering::Relaxed) {
                return Ok(rate_hz);
            }
            let unbiased = Wrench {
                force_n: wrench.force_n - bias.force_n,
                moment_nm: wrench.moment_nm - bias.moment_nm,
            };
            let status = self.plate_status.load(Ordering::Relaxed);
            server.set_faults(faults.plate_faults);
            server.send(plate.record(&unbiased, clock.counter(), status))?;
            if which == 0 {
                self.note_sent(1, time_s);
            }
            Ok(rate_hz)
        })
    }

    fn plate(&self, which: usize) -> (Plate, f64) {
        let first = &self.settings.plate;
        match &self.settings.second_plate {
            Some(second) if which == 1 => (second.plate, second.rate_hz),
            _ => (first.plate, first.rate_hz),
        }
    }

    /// Wrench of a plate on its load, on the simulated floor at a time. An object lies on the first plate.
    fn pressed(&self, which: usize, time_s: f64) -> Wrench {
        let on_plates = *self.on_plates.read().unwrap_or_else(PoisonError::into_inner);
        let here = if which == 0 || on_plates == OnPlates::Worker { on_plates } else { OnPlates::Nothing };
        let worker = || {
            self.with_worker(|worker| match &self.settings.second_plate {
                None => worker.ground_reaction(time_s),
                Some(second) => {
                    ground_reaction_per_foot(worker, time_s, second.press_m.map(Vector2::from))[which]
                }
            })
        };
        here.wrench(worker, time_s)
    }
}
