//! Cumulative dose of the low back, by fatigue failure: LiFFT.
//!
//! Gallagher, Sesek, Schall & Huangfu, "Development and validation of an easy-to-use risk assessment tool for
//! cumulative low back loading: The Lifting Fatigue Failure Tool (LiFFT)", Applied Ergonomics 63 (2017) 142–150. A
//! spine fails after `n = 902416 e^(−0.162 S)` cycles at S per cent of its ultimate strength (10 kN); a lift with the
//! peak load moment M has `0.162 S = 0.038 M + 0.32`, so it does the damage `e^(0.038 M + 0.32) / 902416`; the damages
//! of the day add up to D, and a job is a high-risk one (12 or more injuries in 200 000 hours) with the probability
//! `1 / (1 + e^−(1.72 + 1.03 log10 D))`.
//!
//! **M** is the tool's input: the weight of the load times "the greatest horizontal distance from the hip joint to the
//! center of the load during the lift", measured with a tape (the authors' guidance, version 1.4.1 of 2019-08-26,
//! lifft.pythonanywhere.com/instruction). So M includes neither dynamics nor the weight of the body. Here it is the
//! lifted mass times g times the horizontal distance from the middle of the hip joints to the load; over a lift, the
//! largest value that was reached for [`super::held_peak::PEAK_SPAN_S`] in total, so that no single sample decides. The
//! tool's authors advise caution beyond 100 N m.
//!
//! Not verified: the paper itself was unavailable (its abstract has "from the spine to the load"). The curve, 0.162 and
//! 10 kN are from the published package pyergo; 0.038, 0.32 and the logistic from another implementation that quotes
//! Zelik et al. (Applied Ergonomics 99, 2022), where 30 N m of relief save 70 % of the damage, as they do here. That
//! implementation has the divisor 1 902 416; if it were right, damages would be half of ours and probabilities up to
//! 0.08 lower.
//!
//! A **lift** is an episode of at least half a second in which a load is established to be carried. It ends, and
//! counts, after half a second in which no load is established to be carried. Intervals with withheld torques, as in an
//! impact, and gaps in the data do not end it: a load carried over the outage of a sensor is one lift, not two. A peak
//! within such an interval is missed, and so is the second of two lifts without a hands-free instant that was measured.

use bytemuck::{Pod, Zeroable};

use super::held_peak::HeldPeak;
use super::{Carried, Load};
use crate::GRAVITY_M_PER_S2;
use crate::math;
use crate::message::ground::WRENCH_MAX;

/// Minimum duration of a lift, and of a rest that ends one, s: shorter episodes are mere contacts.
pub const LIFT_MIN_S: f64 = 0.5;

/// Maximum duration of a lift, s: a year.
const CARRIED_MAX_S: f64 = 366.0 * 86_400.0;

/// Number of lifts stored individually: they can be undone, and a consumer that reads twice per second receives all of
/// them.
pub const LATEST_LIFTS: usize = 16;

/// One completed lift.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Lift {
    /// Number, from 1 in each shift; 0 for none.
    pub number: u64,
    /// Time of the last sample with the load, CLOCK_MONOTONIC, ns.
    pub ended_ns: u64,
    /// Total time with the load, s.
    pub carried_s: f64,
    /// Mean of the mass over that time, and of its 1-σ, kg; the errors within one lift are fully correlated.
    pub mass_kg: [f64; 2],
    /// Peak moment of the load over the mean weight: its distance from the hip joints at the peak, m.
    pub distance_m: f64,
    /// Its contribution to the damage.
    pub damage: f64,
    /// 1 if it was undone.
    pub undone: u64,
}

/// The dose since the start of this subject's shift.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Dose {
    /// D; 1 is failure.
    pub damage: f64,
    /// Number of lifts that count.
    pub lifts: u64,
    /// Number of completed lifts, including those that were undone.
    pub ended: u64,
    /// The last lifts: that of number n is at (n − 1) mod [`LATEST_LIFTS`].
    pub latest: [Lift; LATEST_LIFTS],
    /// Time with the load in the current episode, s; 0 between episodes.
    carried_s: f64,
    /// Peak load moment of that episode, N m.
    peak_nm: HeldPeak,
    /// Integral of mass and 1-σ over that time, kg s.
    mass_kg_s: [f64; 2],
    /// Time of the last sample with the load, ns.
    last_load_ns: u64,
    /// Time without a load since then, s.
    empty_s: f64,
}

impl Lift {
    /// Whether every number is in range; a stored one is checked before use.
    pub fn is_sound(&self) -> bool {
        let [weight_n, sigma_n] = self.mass_kg.map(|kg| kg * GRAVITY_M_PER_S2);
        // Weight and moment are measured by a plate.
        let bounded = [
            (self.carried_s, CARRIED_MAX_S),
            (weight_n, WRENCH_MAX),
            (sigma_n, WRENCH_MAX),
            (weight_n * self.distance_m, WRENCH_MAX),
            (self.distance_m, f64::MAX),
            (self.damage, 1.0),
        ];
        bounded.iter().all(|(number, most)| (0.0..=*most).contains(number)) && self.undone <= 1
    }
}

/// Damage of one lift with this peak moment of the load, N m; at most 1.
pub fn damage_of_lift(peak_moment_nm: f64) -> f64 {
    (math::exp(0.038 * peak_moment_nm + 0.32) / 902_416.0).min(1.0)
}

/// Probability of a high-risk job with this daily damage, in [0, 1]; 0 without any.
pub fn probability(damage: f64) -> f64 {
    if damage <= 0.0 {
        return 0.0;
    }
    let log10 = math::ln(damage) / core::f64::consts::LN_10;
    1.0 / (1.0 + math::exp(-(1.72 + 1.03 * log10)))
}

impl Dose {
    /// Advances by one time step under a load, up to `time_ns`.
    pub(super) fn advance(&mut self, load: &Load, step_s: f64, time_ns: u64) {
        match *load {
            Load::Unknown => {}
            Load::Known { carried: carried @ Carried { mass_kg: [mass_kg, sigma_kg], .. }, .. }
                if mass_kg > 0.0 =>
            {
                self.carried_s += step_s;
                self.empty_s = 0.0;
                self.last_load_ns = time_ns;
                self.mass_kg_s[0] += mass_kg * step_s;
                self.mass_kg_s[1] += sigma_kg * step_s;
                self.peak_nm.add(carried.moment_nm(), step_s);
            }
            Load::None | Load::Known { .. } => {
                self.empty_s += step_s;
                if self.empty_s >= LIFT_MIN_S {
                    self.end_lift();
                }
            }
        }
    }

    /// Ends the episode; counts it if it was a lift.
    pub(super) fn end_lift(&mut self) {
        let carried_s = self.carried_s;
        if carried_s >= LIFT_MIN_S {
            let peak_nm = self.peak_nm.value();
            let mass_kg = self.mass_kg_s.map(|kg_s| kg_s / carried_s);
            let damage = damage_of_lift(peak_nm);
            self.damage += damage;
            (self.lifts, self.ended) = (self.lifts.saturating_add(1), self.ended.saturating_add(1));
            self.latest[(self.ended - 1) as usize % LATEST_LIFTS] = Lift {
                number: self.ended,
                ended_ns: self.last_load_ns,
                carried_s,
                mass_kg,
                distance_m: peak_nm / (mass_kg[0] * GRAVITY_M_PER_S2),
                damage,
                undone: 0,
            };
        }
        let Dose { damage, lifts, ended, latest, .. } = *self;
        *self = Dose::restored(damage, lifts, ended, latest);
    }

    /// Restores accumulated values, without a lift in progress.
    pub(super) fn restored(damage: f64, lifts: u64, ended: u64, latest: [Lift; LATEST_LIFTS]) -> Dose {
        Dose { damage, lifts, ended, latest, ..Zeroable::zeroed() }
    }

    /// Undoes the last lift that was not undone yet, and removes it from damage and count. Returns whether there was
    /// one among the latest lifts.
    pub fn undo_lift(&mut self) -> bool {
        let is_counted = |lift: &&mut Lift| lift.number > 0 && lift.undone == 0;
        let Some(lift) = self.latest.iter_mut().filter(is_counted).max_by_key(|lift| lift.number) else {
            return false;
        };
        lift.undone = 1;
        self.lifts = self.lifts.saturating_sub(1);
        // After the last lift is undone, the rounding error of the sum must not remain.
        self.damage = if self.lifts == 0 { 0.0 } else { (self.damage - lift.damage).max(0.0) };
        true
    }

    /// Whether every number is in range.
    pub fn is_sound(&self) -> bool {
        [self.damage, self.carried_s, self.empty_s].iter().all(|value| value.is_finite() && *value >= 0.0)
            && self.mass_kg_s.iter().all(|value| value.is_finite() && *value >= 0.0)
            && self.peak_nm.is_sound()
            && self.latest.iter().all(Lift::is_sound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::JOINTS;

    fn lift(moment_nm: f64) -> Load {
        // Half a metre from the hips.
        let carried = Carried { mass_kg: [moment_nm / (GRAVITY_M_PER_S2 * 0.5), 0.5], distance_m: 0.5 };
        Load::Known { torque_nm: [0.0; JOINTS], carried }
    }

    #[test]
    fn the_damage_is_that_of_the_cycles_to_failure() {
        for moment_nm in [0.0, 40.0, 90.0] {
            // S in per cent, and the curve as published.
            let strength_percent = (0.038 * moment_nm + 0.32) / 0.162;
            let cycles = 902_416.0 * f64::exp(-0.162 * strength_percent);
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
                dose.advance(&lift(moment_nm), 0.01, 0);
                dose.advance(&Load::Unknown, 0.01, 0);
            }
        }
        // A moment below the threshold does not split a lift in two.
        dose.advance(&Load::None, 0.4, 0);
        dose.advance(&lift(30.0), 0.6, 0);
        assert_eq!((dose.lifts, dose.damage), (0, 0.0));
        dose.advance(&Load::None, 0.3, 0);
        dose.advance(&Load::None, 0.3, 0);
        dose.advance(&Load::None, 0.6, 0);
        assert_eq!((dose.lifts, dose.damage), (1, damage_of_lift(55.0)));
        assert!(dose.is_sound());
    }

    #[test]
    fn a_fault_of_20_ms_changes_no_dose_and_a_peak_of_200_ms_does() {
        // Moments at 100 Hz; a plate's fault of 20 ms doubles two of them.
        let dose_with = |count: u32, moment_nm: f64| {
            let mut dose: Dose = Zeroable::zeroed();
            (0..200).for_each(|_| dose.advance(&lift(40.0), 0.01, 0));
            (0..count).for_each(|_| dose.advance(&lift(moment_nm), 0.01, 0));
            (0..200).for_each(|_| dose.advance(&lift(40.0), 0.01, 0));
            dose.advance(&Load::None, 0.6, 0);
            dose.damage
        };
        assert_eq!(dose_with(2, 80.0), damage_of_lift(40.0));
        assert_eq!(dose_with(20, 80.0), damage_of_lift(80.0));
    }

    #[test]
    fn a_touch_and_a_push_from_below_are_no_lifts() {
        let mut dose: Dose = Zeroable::zeroed();
        for _ in 0..40 {
            dose.advance(&lift(50.0), 0.01, 0);
        }
        dose.advance(&Load::None, 0.6, 0);
        let carried = Carried { mass_kg: [-3.0, 0.5], distance_m: 0.3 };
        let leaning = Load::Known { torque_nm: [9.0; JOINTS], carried };
        for _ in 0..100 {
            dose.advance(&leaning, 0.01, 0);
        }
        dose.advance(&Load::None, 0.6, 0);
        assert_eq!((dose.lifts, dose.damage), (0, 0.0));
    }

    #[test]
    fn each_lift_is_on_record_and_can_be_taken_back_from_the_last_on() {
        let mut dose: Dose = Zeroable::zeroed();
        assert!(!dose.undo_lift());
        for (index, moment_nm) in [40.0, 50.0, 60.0].into_iter().enumerate() {
            dose.advance(&lift(0.5 * moment_nm), 0.4, 0);
            dose.advance(&lift(moment_nm), 0.8, 100 + index as u64);
            dose.advance(&Load::None, 1.0, 200);
        }
        let sum = |dose: &Dose| -> f64 {
            dose.latest.iter().filter(|lift| lift.undone == 0).map(|lift| lift.damage).sum()
        };
        assert!((dose.damage - sum(&dose)).abs() < 1e-18);
        let Lift { number, ended_ns, carried_s, mass_kg: [mass_kg, sigma_kg], distance_m, damage, .. } =
            dose.latest[1];
        assert_eq!((number, ended_ns, damage), (2, 101, damage_of_lift(50.0)));
        // 25 N m for 0.4 s and 50 N m for 0.8 s at half a metre.
        let mean_kg = 2.0 * (25.0 + 2.0 * 50.0) / 3.0 / GRAVITY_M_PER_S2;
        assert!(
            (carried_s - 1.2).abs() < 1e-12
                && (mass_kg - mean_kg).abs() < 1e-12
                && (sigma_kg - 0.5).abs() < 1e-12
        );
        assert!((mass_kg * GRAVITY_M_PER_S2 * distance_m - 50.0).abs() < 1e-9);
        assert!(dose.undo_lift());
        assert_eq!((dose.lifts, dose.ended), (2, 3));
        assert!((dose.damage - damage_of_lift(40.0) - damage_of_lift(50.0)).abs() < 1e-18);
        // A subsequent lift has a new number.
        dose.advance(&lift(70.0), 0.8, 300);
        dose.advance(&Load::None, 1.0, 400);
        assert_eq!((dose.latest[3].number, dose.latest[2].undone), (4, 1));
        while dose.undo_lift() {}
        assert_eq!((dose.lifts, dose.damage), (0, 0.0));
        assert!(dose.is_sound());
    }

    #[test]
    fn a_lift_beyond_a_plate_s_range_is_unsound() {
        let lift =
            Lift { number: 1, carried_s: 2.0, mass_kg: [8.0, 0.5], distance_m: 0.4, ..Zeroable::zeroed() };
        assert!(lift.is_sound());
        for unsound in [
            Lift { carried_s: 4e7, ..lift },
            Lift { mass_kg: [2e5, 0.5], ..lift },
            Lift { mass_kg: [8.0, 2e5], ..lift },
            Lift { mass_kg: [8.0, -0.5], ..lift },
            Lift { distance_m: 2e4, ..lift },
            Lift { distance_m: f64::NAN, ..lift },
            Lift { damage: 1.1, ..lift },
        ] {
            assert!(!unsound.is_sound(), "{unsound:?}");
        }
    }

    #[test]
    fn lifts_no_longer_among_the_latest_stay() {
        let mut dose: Dose = Zeroable::zeroed();
        for _ in 0..LATEST_LIFTS + 4 {
            dose.advance(&lift(60.0), 0.6, 0);
            dose.advance(&Load::None, 1.0, 0);
        }
        while dose.undo_lift() {}
        assert_eq!(dose.lifts, 4);
        assert!((dose.damage - 4.0 * damage_of_lift(60.0)).abs() < 1e-15);
    }

    #[test]
    fn equal_lifts_add_up() {
        let mut dose: Dose = Zeroable::zeroed();
        for _ in 0..3 {
            dose.advance(&lift(60.0), 0.6, 0);
            dose.advance(&Load::None, 1.0, 0);
        }
        assert_eq!(dose.lifts, 3);
        assert!((dose.damage - 3.0 * damage_of_lift(60.0)).abs() < 1e-18);
    }
}
