//! Stomping: standing on the left foot, the right one is raised slowly and stamped down, repeatedly.
//!
//! The weight stays on the left foot, so the floor's force is only that which stops the leg: the height of the force
//! step follows from the person's leg, not from a parameter here.

use core::f64::consts::FRAC_PI_2;

use crate::schedule::minimum_jerk;
use crate::stance::Stance;

/// Duration of the weight's shift to the left foot, and back, s.
const SHIFT_S: f64 = 1.2;
/// Fraction of the distance to the left ankle that it covers.
const SHIFTED: f64 = 0.95;
/// Duration and height of raising the foot, s and m.
const RAISE: (f64, f64) = (0.5, 0.12);
/// Acceleration of its fall and terminal speed, m/s² and m/s.
const FALL: (f64, f64) = (40.0, 1.6);
/// Floor, shoe and heel stop it within this time, s, like a spring.
const STOP_S: f64 = 0.022;
/// Pauses between raisings, s: an irregular beat, since a regular one would also match when shifted by one beat.
const PAUSES_S: [f64; 5] = [1.4, 2.1, 1.6, 2.7, 1.9];
/// The knees are slightly bent meanwhile: the pelvis sinks by this fraction of its height.
const SINK: f64 = 0.08;

/// One bout of stomping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stomps {
    start_s: f64,
    count: u32,
    aside_m: f64,
}

impl Stomps {
    /// `count` stomps of the right foot in a stance; the first comes some 2.5 s after `start_s`.
    pub fn new(stance: &Stance, start_s: f64, count: u32) -> Stomps {
        let aside_m = 0.5 * (stance.ankle_m[0] - stance.ankle_m[1]).xy().norm() * SHIFTED;
        Stomps { start_s, count, aside_m }
    }

    /// Its end, s.
    pub fn end_s(&self) -> f64 {
        self.raised_s(self.count) + SHIFT_S
    }

    /// Whether it is in progress.
    pub fn lasts(&self, time_s: f64) -> bool {
        (self.start_s..self.end_s()).contains(&time_s)
    }

    /// Times of the foot's impacts, s: when half of its speed is lost.
    pub fn hits_s(&self) -> impl Iterator<Item = f64> + use<'_> {
        // cos 60° of a spring's quarter period.
        (0..self.count).map(|index| self.raised_s(index) + RAISE.0 + fall().ends_s - STOP_S / 3.0)
    }

    /// Start of the n-th raising of the foot, s.
    fn raised_s(&self, index: u32) -> f64 {
        let pauses_s: f64 = PAUSES_S.iter().cycle().take(index as usize).sum();
        self.start_s + SHIFT_S + pauses_s
    }

    /// Displacement of the centre of mass to the left at a time, m.
    pub fn aside_m(&self, time_s: f64) -> f64 {
        self.aside_m * self.activation(time_s)
    }

    /// Lowering of the pelvis at a time, as a fraction of its height.
    pub fn sink(&self, time_s: f64) -> f64 {
        SINK * self.activation(time_s)
    }

    fn activation(&self, time_s: f64) -> f64 {
        minimum_jerk((time_s - self.start_s) / SHIFT_S) * minimum_jerk((self.end_s() - time_s) / SHIFT_S)
    }

    /// Heights of the left and right foot at a time, m.
    pub fn lift_m(&self, time_s: f64) -> [f64; 2] {
        let begun =
            (0..self.count).rev().map(|index| self.raised_s(index)).find(|begun_s| *begun_s <= time_s);
        let Some(begun_s) = begun else { return [0.0; 2] };
        let since_s = time_s - begun_s;
        if since_s < RAISE.0 {
            [0.0, RAISE.1 * minimum_jerk(since_s / RAISE.0)]
        } else {
            [0.0, fall().at(since_s - RAISE.0)]
        }
    }
}

/// A fall from the full height: accelerating, then constant, then stopped.
#[derive(Debug, Clone, Copy)]
struct Fall {
    accelerates_s: f64,
    even_s: f64,
    ends_s: f64,
}

fn fall() -> Fall {
    let (acceleration, speed) = FALL;
    let accelerates_s = speed / acceleration;
    let even_s = RAISE.1 / speed - 0.5 * accelerates_s - STOP_S / FRAC_PI_2;
    Fall { accelerates_s, even_s, ends_s: accelerates_s + even_s + STOP_S }
}

impl Fall {
    /// Height this long after its start, m.
    fn at(&self, since_s: f64) -> f64 {
        let (acceleration, speed) = FALL;
        let even_s = (since_s - self.accelerates_s).clamp(0.0, self.even_s);
        let accelerated_s = since_s.clamp(0.0, self.accelerates_s);
        let stopping = ((since_s - self.accelerates_s - self.even_s) / STOP_S).clamp(0.0, 1.0);
        if since_s < self.accelerates_s + self.even_s {
            RAISE.1 - 0.5 * acceleration * accelerated_s * accelerated_s - speed * even_s
        } else {
            speed * STOP_S / FRAC_PI_2 * (1.0 - (FRAC_PI_2 * stopping).sin())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{Habits, Worker};
    use crate::person::Person;
    use equipoise_core::body::Side;

    #[test]
    fn the_foot_comes_down_at_once_and_the_floor_feels_it() {
        for (height_m, mass_kg) in [(1.55, 52.0), (1.77, 72.0), (1.95, 100.0)] {
            let mut worker = Worker::with_habits(Person::new(3, height_m, mass_kg), 3, Habits::ORDINARY);
            let stomps = Stomps::new(worker.stance(), 1.0, 3);
            let end_s = worker.stomp(1.0, 3);
            let force_n = |time_s: f64| worker.ground_reaction(time_s).force_n.z;
            for hit_s in stomps.hits_s() {
                let around = (-60..60).map(|ms| force_n(hit_s + 1e-3 * f64::from(ms)));
                let (least, most) = around.fold((f64::INFINITY, 0.0_f64), |(a, b), n| (a.min(n), b.max(n)));
                assert!(most - least > 300.0, "{height_m} m: {least} to {most} N");
                assert!(least > 0.0, "the feet stay on the plate: {least} N");
            }
            let mut step_s = 0.0;
            while step_s < end_s {
                let body = worker.sample(step_s);
                let left_m = body.origin_m[Side::Left.foot().index()].z;
                assert!((left_m - worker.stance().ankle_m[0].z).abs() < 1e-3, "the left foot stays");
                step_s += 0.01;
            }
        }
    }

    #[test]
    fn the_fall_runs_on_without_a_leap() {
        let fall = fall();
        assert!(fall.even_s > 0.0);
        assert!((fall.at(0.0) - RAISE.1).abs() < 1e-12 && fall.at(fall.ends_s).abs() < 1e-12);
        for step in 0..2000 {
            let (a, b) = (fall.at(f64::from(step) * 1e-4), fall.at(f64::from(step + 1) * 1e-4));
            assert!(b <= a + 1e-12 && a - b <= FALL.1 * 1e-4 + 1e-12, "{step}: {a} {b}");
        }
    }
}
