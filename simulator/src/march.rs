//! Marching on the spot: the feet leave the floor alternately while the centre of mass swings sideways.
//!
//! A standing person's centre of pressure is `p = y − ÿ z/g` (z: height of the centre of mass y). A sideways swing
//! `y = A sin ωt` has its centre of pressure at `(1 + ω² z/g) y`: a small sway of the body shifts all weight from foot to
//! foot. A third harmonic keeps it longer under each foot, and a foot is in the air only during that time.

use core::f64::consts::PI;

use crate::GRAVITY_M_PER_S2;
use crate::person::Person;
use crate::schedule::minimum_jerk;
use crate::stance::Stance;

/// From one footfall to the next, s: 86 steps a minute.
const STEP_S: f64 = 0.70;
/// Lift height of a foot, m.
const LIFT_M: f64 = 0.09;
/// Height of a standing person's centre of mass over stature.
const CENTRE_HEIGHT: f64 = 0.56;
/// Swing of the centre of pressure relative to the distance of an ankle from the middle: frequencies as multiples of
/// the stride frequency, and their amplitudes.
const SWING: [(f64, f64); 2] = [(1.0, 1.20), (3.0, 0.24)];
/// Fraction of a step in which the foot is in the air, centred in the step.
const IN_THE_AIR: f64 = 0.65;
/// The knees are slightly bent meanwhile: the pelvis sinks by this fraction of its height. With a straight leg the foot
/// could not leave the floor without a jerk of the knee.
const SINK: f64 = 0.08;
/// The swing builds up and decays over this many steps, during which both feet stand.
const RAMP_STEPS: f64 = 2.0;

/// One bout of marching.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct March {
    start_s: f64,
    steps: f64,
    /// Amplitudes of the centre of mass at the frequencies of the swing.
    amplitude_m: [f64; SWING.len()],
}

impl March {
    /// `steps` steps in a stance; the first foot, the right one, leaves the floor some 1.5 s after `start_s`.
    pub fn new(person: &Person, stance: &Stance, start_s: f64, steps: u32) -> March {
        let ankle_aside_m = 0.5 * (stance.ankle_m[0] - stance.ankle_m[1]).xy().norm();
        let falls_s2 = CENTRE_HEIGHT * person.height_m / GRAVITY_M_PER_S2;
        let amplitude_m = SWING.map(|(frequency, amplitude)| {
            amplitude * ankle_aside_m / (1.0 + (frequency * PI / STEP_S).powi(2) * falls_s2)
        });
        March { start_s, steps: f64::from(steps), amplitude_m }
    }

    /// Its end, s.
    pub fn end_s(&self) -> f64 {
        self.start_s + (self.steps + 2.0 * RAMP_STEPS) * STEP_S
    }

    /// Whether it is in progress.
    pub fn lasts(&self, time_s: f64) -> bool {
        (self.start_s..self.end_s()).contains(&time_s)
    }

    /// Displacement of the centre of mass to the left at a time, m.
    pub fn aside_m(&self, time_s: f64) -> f64 {
        let stride_rad = PI * (time_s - self.start_s) / STEP_S;
        let swing = SWING.iter().zip(self.amplitude_m);
        let swing_m: f64 =
            swing.map(|((frequency, _), amplitude_m)| amplitude_m * (frequency * stride_rad).sin()).sum();
        self.activation(time_s) * swing_m
    }

    /// Lowering of the pelvis at a time, as a fraction of its height.
    pub fn sink(&self, time_s: f64) -> f64 {
        SINK * self.activation(time_s)
    }

    /// Activation: 0 at both ends, 1 while the feet are raised.
    fn activation(&self, time_s: f64) -> f64 {
        let ramp_s = RAMP_STEPS * STEP_S;
        minimum_jerk((time_s - self.start_s) / ramp_s) * minimum_jerk((self.end_s() - time_s) / ramp_s)
    }

    /// Heights of the left and right foot at a time, m.
    pub fn lift_m(&self, time_s: f64) -> [f64; 2] {
        let step = (time_s - self.start_s) / STEP_S;
        if !(RAMP_STEPS..RAMP_STEPS + self.steps).contains(&step) {
            return [0.0; 2];
        }
        // 0 to 1 and back within the time in the air, at rest at both ends.
        let within = (step.fract() - 0.5).abs() / (0.5 * IN_THE_AIR);
        let lift_m = LIFT_M * minimum_jerk(1.0 - within);
        // In even steps the weight is on the left.
        if (step as u64).is_multiple_of(2) { [0.0, lift_m] } else { [lift_m, 0.0] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{Habits, Worker};
    use equipoise_core::body::Side;

    #[test]
    fn the_weight_stays_on_the_foot_that_stands() {
        for (height_m, mass_kg) in [(1.55, 52.0), (1.77, 72.0), (1.95, 100.0)] {
            let mut worker = Worker::with_habits(Person::new(3, height_m, mass_kg), 3, Habits::ORDINARY);
            worker.march_on_the_spot(1.0, 6);
            let outline = worker.person().foot_outline_m;
            let (mut in_the_air, mut highest_m) = ([0, 0], 0.0_f64);
            for centisecond in 0..1000 {
                let time_s = f64::from(centisecond) * 0.01;
                let body = worker.sample(time_s);
                let cop = worker.ground_reaction(time_s).cop_m();
                let margin_m = worker.stance().margin_m(cop);
                assert!(margin_m > 0.0, "{height_m} m at {time_s} s: outside the feet by {margin_m} m");
                for (k, side) in Side::BOTH.into_iter().enumerate() {
                    let ankle_m = worker.stance().ankle_m[k];
                    let lift_m = body.origin_m[side.foot().index()].z - ankle_m.z;
                    highest_m = highest_m.max(lift_m);
                    if lift_m < 1e-3 {
                        continue;
                    }
                    in_the_air[k] += 1;
                    let (other_m, turn) =
                        (worker.stance().ankle_m[1 - k], worker.stance().world_from_foot[1 - k]);
                    let on_foot = turn.inverse() * (cop - other_m.xy()).push(0.0);
                    assert!(
                        on_foot.y.abs() < outline.half_width
                            && (-outline.back..outline.forward).contains(&on_foot.x),
                        "{height_m} m at {time_s} s, foot {k} in the air: {on_foot:?} of {outline:?}"
                    );
                }
            }
            assert!((highest_m - LIFT_M).abs() < 2e-3, "{highest_m}");
            assert!(in_the_air.iter().all(|&samples| samples > 60), "{in_the_air:?}");
        }
    }

    #[test]
    fn nothing_jumps_and_afterwards_both_feet_stand() {
        let person = Person::nominal(1.77, 72.0);
        let march = March::new(&person, &Stance::shoulder_wide(&person), 1.0, 4);
        assert_eq!(march.lift_m(march.end_s()), [0.0; 2]);
        assert!(march.aside_m(march.end_s()).abs() < 1e-12 && march.aside_m(1.0).abs() < 1e-12);
        let h = 1e-4;
        for step in 0..700 {
            let time_s = 0.01 * f64::from(step);
            let acceleration =
                |at: &dyn Fn(f64) -> f64| (at(time_s + h) - 2.0 * at(time_s) + at(time_s - h)) / (h * h);
            assert!(acceleration(&|t| march.aside_m(t)).abs() < 10.0);
            assert!(acceleration(&|t| march.lift_m(t)[0]).abs() < 30.0);
        }
    }
}
