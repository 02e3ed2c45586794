//! Cumulative dose of the low back, by fatigue failure: LiFFT.
//!
//! Gallagher, Sesek, Schall & Huangfu, "Development and validation of an easy-to-use risk assessment tool for
//! cumulative low back loading: The Lifting Fatigue Failure Tool (LiFFT)", Applied Ergonomics 63 (2017) 142–150. A
//! spine fails after `n = 902416 e^(−0.162 S)` cycles at S per cent of its ultimate strength (10 kN); a lift with the
//! peak load moment M has `0.162 S = 0.038 M + 0.32`, so it does the damage `e^(0.038 M + 0.32) / 902416`; the damages
//! of the day add up to D, and a job is a high-risk one (12 or more injuries in 200 000 hours) with the probability
//! `1 / (1 + e^−(1.72 + 1.03 log10 D))`.
//!
//! **M** is what the tool's users enter: the weight of the load times "the greatest horizontal distance from the hip
//! joint to the center of the load during the lift", taken with a measuring tape (the authors' guidance, version 1.4.1 of
//! 2019-08-26, lifft.pythonanywhere.com/instruction). So M has no dynamics and no weight of the body. Here it is the
//! lifted mass times g times the horizontal distance from the middle of the hip joints to the load; of its course in a
//! lift, the largest value that was reached for [`super::held_peak::PEAK_SPAN_S`] in total, so that no single sample
//! decides. The tool's authors advise care beyond 100 N m.
//!
//! Not verified: the paper itself was not at hand (its abstract says "from the spine to the load"). The curve, 0.162 and
//! 10 kN stand so in the published package pyergo; 0.038, 0.32 and the logistic in another implementation that quotes
//! Zelik et al. (Applied Ergonomics 99, 2022), where 30 N m of relief save 70 % of the damage, as they do here. That
//! second one prints the divisor as 1 902 416; if it were right, damages would be half of ours and probabilities up to
//! 0.08 lower.
//!
//! A **lift** is an episode of at least half a second in which a load is known to be carried. It ends, and counts, when
//! nothing has been known to be carried for half a second too, or when a gap hides what happened. Where the torques are
//! withheld between, as in an impact, it goes on; a peak that falls into such a time is missed.

use bytemuck::{Pod, Zeroable};

use super::Load;
use super::held_peak::HeldPeak;
use crate::math;

/// Shorter episodes are touches, not lifts, and shorter rests do not end one, s.
pub const LIFT_MIN_S: f64 = 0.5;

/// The dose since this worker began.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Dose {
    /// D; 1 is failure.
    pub damage: f64,
    /// Lifts that entered it.
    pub lifts: u64,
    /// How long a load has been known to be carried in the episode under way, s; 0 between episodes.
    carried_s: f64,
    /// Largest load moment of that episode, N m.
    peak_nm: HeldPeak,
    /// How long nothing has been known to be carried since, s.
    empty_s: f64,
}

/// Damage of one lift with this peak moment of the load, N m; at most 1.
pub fn damage_of_lift(peak_moment_nm: f64) -> f64 {
    (math::exp(0.038 * peak_moment_nm + 0.32) / 902_416.0).min(1.0)
}

/// Probability of a high-risk job with this damage a day, in [0, 1]; 0 without any.
pub fn probability(damage: f64) -> f64 {
    if damage <= 0.0 {
        return 0.0;
    }
    let log10 = math::ln(damage) / core::f64::consts::LN_10;
    1.0 / (1.0 + math::exp(-(1.72 + 1.03 * log10)))
}

impl Dose {
    /// One step of time under a load.
    pub(super) fn advance(&mut self, load: &Load, step_s: f64) {
        match *load {
            Load::Unknown => {}
            Load::Known { lift_moment_nm, is_lift: true, .. } => {
                self.carried_s += step_s;
                self.empty_s = 0.0;
                self.peak_nm.add(lift_moment_nm, step_s);
            }
            Load::None | Load::Known { .. } => {
                self.empty_s += step_s;
                if self.empty_s >= LIFT_MIN_S {
                    self.end_lift();
                }
            }
        }
    }

    /// The episode is over; a lift counts.
    pub(super) fn end_lift(&mut self) {
        if self.carried_s >= LIFT_MIN_S {
            self.damage += damage_of_lift(self.peak_nm.value());
            self.lifts = self.lifts.saturating_add(1);
        }
        (self.carried_s, self.peak_nm, self.empty_s) = (0.0, HeldPeak::zeroed(), 0.0);
    }

    /// Whether every number is in range.
    pub fn is_sound(&self) -> bool {
        [self.damage, self.carried_s, self.empty_s].iter().all(|value| value.is_finite() && *value >= 0.0)
            && self.peak_nm.is_sound()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::JOINTS;

    fn lift(moment_nm: f64) -> Load {
        Load::Known { torque_nm: [0.0; JOINTS], lift_moment_nm: moment_nm, is_lift: true }
    }

    #[test]
    fn the_damage_is_that_of_the_cycles_to_failure() {
        for moment_nm in [0.0, 40.0, 90.0] {
            // S in per cent, and the curve as it is published.
            let share = (0.038 * moment_nm + 0.32) / 0.162;
            let cycles = 902_416.0 * f64::exp(-0.162 * share);
            assert!((damage_of_lift(moment_nm) * cycles - 1.0).abs() < 1e-12);
        }
        let spared = 1.0 - damage_of_lift(70.0) / damage_of_lift(100.0);
        assert!((spared - 0.68).abs() < 0.01, "30 N m of relief spare about 70 %: {spared}");
        assert_eq!(damage_of_lift(1e9), 1.0);
    }

    #[test]
    fn the_probability_rises_with_the_damage_and_is_even_at_two_hundredths() {
        assert_eq!(probability(0.0), 0.0);
        assert!((probability(10f64.powf(-1.72 / 1.03)) - 0.5).abs() < 1e-12);
        let rising = [1e-9, 1e-4, 0.01, 0.1, 1.0, 50.0].map(probability);
        assert!(rising.is_sorted() && rising.iter().all(|p| (0.0..=1.0).contains(p)), "{rising:?}");
    }

    #[test]
    fn a_lift_counts_once_at_its_end_with_its_peak() {
        let mut dose: Dose = Zeroable::zeroed();
        for moment_nm in [20.0, 55.0, 30.0] {
            for _ in 0..30 {
                dose.advance(&lift(moment_nm), 0.01);
                dose.advance(&Load::Unknown, 0.01);
            }
        }
        // A moment below the threshold does not make two lifts of one.
        dose.advance(&Load::None, 0.4);
        dose.advance(&lift(30.0), 0.6);
        assert_eq!((dose.lifts, dose.damage), (0, 0.0));
        dose.advance(&Load::None, 0.3);
        dose.advance(&Load::None, 0.3);
        dose.advance(&Load::None, 0.6);
        assert_eq!((dose.lifts, dose.damage), (1, damage_of_lift(55.0)));
        assert!(dose.is_sound());
    }

    #[test]
    fn a_fault_of_20_ms_changes_no_dose_and_a_peak_of_200_ms_does() {
        // Moments at 100 Hz; a plate's fault of 20 ms doubles two of them.
        let dose_with = |count: u32, moment_nm: f64| {
            let mut dose: Dose = Zeroable::zeroed();
            (0..200).for_each(|_| dose.advance(&lift(40.0), 0.01));
            (0..count).for_each(|_| dose.advance(&lift(moment_nm), 0.01));
            (0..200).for_each(|_| dose.advance(&lift(40.0), 0.01));
            dose.advance(&Load::None, 0.6);
            dose.damage
        };
        assert_eq!(dose_with(2, 80.0), damage_of_lift(40.0));
        assert_eq!(dose_with(20, 80.0), damage_of_lift(80.0));
    }

    #[test]
    fn a_touch_and_a_push_from_below_are_no_lifts() {
        let mut dose: Dose = Zeroable::zeroed();
        for _ in 0..40 {
            dose.advance(&lift(50.0), 0.01);
        }
        dose.advance(&Load::None, 0.6);
        let leaning = Load::Known { torque_nm: [9.0; JOINTS], lift_moment_nm: 0.0, is_lift: false };
        for _ in 0..100 {
            dose.advance(&leaning, 0.01);
        }
        dose.advance(&Load::None, 0.6);
        assert_eq!((dose.lifts, dose.damage), (0, 0.0));
    }

    #[test]
    fn equal_lifts_add_up() {
        let mut dose: Dose = Zeroable::zeroed();
        for _ in 0..3 {
            dose.advance(&lift(60.0), 0.6);
            dose.advance(&Load::None, 1.0);
        }
        assert_eq!(dose.lifts, 3);
        assert!((dose.damage - 3.0 * damage_of_lift(60.0)).abs() < 1e-18);
    }
}
