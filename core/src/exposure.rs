//! Exposure of the worker over time, and advice: quantities for ergonomists and cobots.
//!
//! Mass and reach of the load ([`lift`]), moment and compression of the low back ([`back`]), fatigue of the joints
//! ([`fatigue`]), dose of the low back ([`dose`]), and the direction in which to move the load ([`advice`]).
//! `docs/ergonomics.md` lists formulas, sources and limits.

pub mod advice;
pub mod back;
pub mod dose;
pub mod fatigue;
pub mod held_peak;
pub mod lift;

use bytemuck::{Pod, Zeroable};

use crate::GRAVITY_M_PER_S2;
use crate::body::JOINTS;
use crate::time::{NS_PER_S, seconds};

pub use advice::Advice;
pub use back::Back;
pub use dose::{Dose, LATEST_LIFTS, Lift};
pub use fatigue::Fatigue;

/// Longer intervals between samples count as gaps without data, ns.
pub const GAP_NS: u64 = NS_PER_S;

/// After a pause this long a new shift begins, s: longer than any break of a working day, shorter than any night.
pub const SHIFT_ENDS_S: u64 = 4 * 3600;

/// State of the load during one time step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Load {
    /// The torques are withheld: no conclusion is possible.
    Unknown,
    /// No load is carried: established, not assumed.
    None,
    /// The overload torques are valid.
    Known {
        /// Magnitude of each joint's overload, N m.
        torque_nm: [f64; JOINTS],
        /// The carried load.
        carried: Carried,
    },
}

/// A mass in the hands and its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    /// The mass and its 1-σ, kg; not positive if the subject is supported or leans.
    pub mass_kg: [f64; 2],
    /// Its horizontal distance from the middle of the hip joints, m.
    pub distance_m: f64,
}

impl Carried {
    /// Its weight at rest times its distance, N m.
    fn moment_nm(&self) -> f64 {
        self.mass_kg[0] * GRAVITY_M_PER_S2 * self.distance_m
    }
}

/// Exposure accumulated over the shift: plain old data in the loop's memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Exposure {
    /// Of each joint.
    pub fatigue: Fatigue,
    /// Of the low back.
    pub dose: Dose,
    /// Time of the previous sample; 0 before the first.
    last_sample_ns: u64,
}

/// The part of a shift that is stored for a later start.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Shift {
    /// Fatigue of each joint, in [0, 1].
    pub fatigue: [f64; JOINTS],
    /// Damage of the low back by the lifts so far.
    pub damage: f64,
    /// Number of lifts.
    pub lifts: u64,
    /// Number of completed lifts, including those that were undone.
    pub ended: u64,
    /// The last lifts; see [`Dose::latest`].
    pub latest: [Lift; LATEST_LIFTS],
}

impl Exposure {
    /// The data to be stored. Excludes a lift in progress: it continues, and counts, once the load is detected again.
    pub fn shift(&self) -> Shift {
        let Dose { damage, lifts, ended, latest, .. } = self.dose;
        Shift { fatigue: self.fatigue.by_joint, damage, lifts, ended, latest }
    }

    /// Continues a shift after a gap without data, for which neither fatigue nor rest is assumed. `ended_ns`: time of its
    /// last sample, wrapped if that is before the clock's zero.
    pub fn resume(&mut self, shift: &Shift, ended_ns: u64) {
        self.start();
        self.last_sample_ns = ended_ns.max(1);
        self.fatigue.by_joint = shift.fatigue;
        let &Shift { damage, lifts, ended, latest, .. } = shift;
        self.dose = Dose::restored(damage, lifts, ended, latest);
    }

    /// Ends a lift in progress, and counts it: the subject is replaced, and what becomes of the load is not known.
    pub fn end_lift(&mut self) {
        self.dose.end_lift();
    }

    /// Resets everything, for another subject or shift.
    pub fn start(&mut self) {
        *self = Zeroable::zeroed();
    }

    /// Advances to the suit sample of `sample_time_ns`; `load` acted since the previous sample, `limit_nm` is the limit
    /// of each joint against it, N m.
    ///
    /// Over a gap longer than [`GAP_NS`], and when time does not advance, the load is unavailable: fatigue and dose stay
    /// constant, and a lift in progress continues, as over an interval with withheld torques. From [`SHIFT_ENDS_S`] on, a
    /// new shift starts.
    pub fn advance(&mut self, sample_time_ns: u64, load: &Load, limit_nm: &[f64; JOINTS]) {
        let step_ns = match self.last_sample_ns {
            0 => 0,
            last_ns => sample_time_ns.wrapping_sub(last_ns).cast_signed().max(0).cast_unsigned(),
        };
        if step_ns >= SHIFT_ENDS_S * NS_PER_S {
            self.start();
        }
        self.last_sample_ns = sample_time_ns;
        if (1..=GAP_NS).contains(&step_ns) {
            self.fatigue.advance(load, limit_nm, seconds(step_ns));
            self.dose.advance(load, seconds(step_ns), sample_time_ns);
        }
    }

    /// Whether every number is in range.
    pub fn is_sound(&self) -> bool {
        self.fatigue.is_sound() && self.dose.is_sound()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn carrying(torque_nm: f64) -> Load {
        let carried = Carried { mass_kg: [8.0, 0.5], distance_m: 0.5 };
        Load::Known { torque_nm: [torque_nm; JOINTS], carried }
    }

    #[test]
    fn a_gap_adds_nothing_and_a_load_carried_over_it_is_one_lift() {
        let limits = [100.0; JOINTS];
        let mut exposure: Exposure = Zeroable::zeroed();
        for sample in 0..=100 {
            exposure.advance(NS_PER_S + sample * 10_000_000, &carrying(30.0), &limits);
        }
        let before = exposure;
        assert!(before.fatigue.by_joint[0] > 0.0 && before.dose.lifts == 0);
        // Over 3 s without data, as with a suit out of radio range, and when time does not advance.
        for time_ns in [5 * NS_PER_S, 5 * NS_PER_S, 4 * NS_PER_S] {
            exposure.advance(time_ns, &carrying(30.0), &limits);
            assert_eq!(bytemuck::bytes_of(&exposure.fatigue), bytemuck::bytes_of(&before.fatigue));
            assert_eq!(bytemuck::bytes_of(&exposure.dose), bytemuck::bytes_of(&before.dose));
        }
        let mut replaced = exposure;
        replaced.end_lift();
        assert_eq!(replaced.dose.lifts, 1);
        for sample in 1..=200 {
            let load = if sample <= 100 { carrying(30.0) } else { Load::None };
            exposure.advance(4 * NS_PER_S + sample * 10_000_000, &load, &limits);
        }
        assert_eq!(exposure.dose.lifts, 1);
        assert!((exposure.dose.latest[0].carried_s - 2.0).abs() < 1e-9);
        assert!(exposure.is_sound());
    }

    #[test]
    fn a_shift_resumed_in_the_evening_does_not_go_on_in_the_morning() {
        let shift = Shift { fatigue: [0.25; JOINTS], damage: 0.01, lifts: 3, ended: 3, ..Zeroable::zeroed() };
        // An hour after the start of the computer, three hours after the last sample.
        let (now_ns, ended_ns) = (3600 * NS_PER_S, 0_u64.wrapping_sub(2 * 3600 * NS_PER_S));
        let lifts_after = |hours: u64| {
            let mut exposure: Exposure = Zeroable::zeroed();
            exposure.resume(&shift, ended_ns);
            exposure.advance(now_ns + hours * 3600 * NS_PER_S, &Load::None, &[100.0; JOINTS]);
            exposure.dose.lifts
        };
        assert_eq!([0, 2].map(lifts_after), [3, 0]);
    }
}
