//! Parts of a profile with their own representation: poses by name, consistency, the shift.

use std::collections::BTreeMap;

use bytemuck::Zeroable;

use equipoise_core::body::{JOINTS, Joint};
use equipoise_core::cycle::identification::Consistency;
use equipoise_core::exposure::{LATEST_LIFTS, Lift, SHIFT_ENDS_S, Shift};
use equipoise_core::handover::experience::Handover;
use equipoise_core::pose_suggestion::library::LIBRARY;
use serde::{Deserialize, Serialize};

/// Maximum number of lifts of a shift: one a second for a century.
const LIFTS_MAX: u64 = u32::MAX as u64;
/// Rounding error of a damage, as a fraction: a sum of lifts less the undone ones.
const DAMAGE_ROUNDING: f64 = 1e-9;

/// Resolution of the stored fatigue: steps from 0 to 1.
const FATIGUE_STEPS: f64 = 1e4;

/// Names of the poses whose bits are set.
pub(super) fn names_of(bits: u64) -> Vec<String> {
    let set = LIBRARY.iter().enumerate().filter(|(index, _)| bits >> index & 1 == 1);
    set.map(|(_, posture)| posture.name.to_owned()).collect()
}

/// Index of a pose in the library.
pub(super) fn index_of(name: &str) -> Option<usize> {
    LIBRARY.iter().position(|posture| posture.name == name)
}

/// The bits of these poses; names that are not in the library are ignored.
pub(super) fn set_of(names: &[String]) -> u64 {
    names.iter().filter_map(|name| index_of(name)).fold(0, |bits, index| bits | 1 << index)
}

/// Fields of [`Consistency`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ConsistencyPart {
    tested: u64,
    since: u64,
    nis: f64,
    square_m2: f64,
    theta_m2: f64,
    rest_m2: f64,
    inflation: f64,
    recent: [f64; 5],
    recent_count: u64,
}

impl ConsistencyPart {
    pub(super) fn of(of: &Consistency) -> ConsistencyPart {
        let &Consistency {
            tested,
            since,
            nis,
            square_m2,
            theta_m2,
            rest_m2,
            inflation,
            recent,
            recent_count,
        } = of;
        ConsistencyPart { tested, since, nis, square_m2, theta_m2, rest_m2, inflation, recent, recent_count }
    }

    pub(super) fn consistency(&self) -> Consistency {
        let &ConsistencyPart {
            tested,
            since,
            nis,
            square_m2,
            theta_m2,
            rest_m2,
            inflation,
            recent,
            recent_count,
        } = self;
        Consistency { tested, since, nis, square_m2, theta_m2, rest_m2, inflation, recent, recent_count }
    }
}

/// [`Shift`] with the time of the data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ShiftPart {
    /// s since 1970 UTC.
    saved_unix_s: u64,
    /// Damage of the low back (LiFFT).
    damage: f64,
    lifts: u64,
    /// Number of completed lifts, including undone ones.
    ended: u64,
    /// By joint; zero for joints that are not listed.
    fatigue: BTreeMap<String, f64>,
    /// Lifts that can be undone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    lift: Vec<LiftPart>,
}

/// [`Lift`] without its time, which is valid for one boot only.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LiftPart {
    number: u64,
    carried_s: f64,
    /// With its 1-σ.
    mass_kg: [f64; 2],
    distance_m: f64,
    damage: f64,
    undone: bool,
}

impl LiftPart {
    fn of(lift: &Lift) -> LiftPart {
        let Lift { number, carried_s, mass_kg, distance_m, damage, undone, .. } = *lift;
        LiftPart { number, carried_s, mass_kg, distance_m, damage, undone: undone == 1 }
    }

    fn lift(&self) -> Lift {
        let LiftPart { number, carried_s, mass_kg, distance_m, damage, undone } = *self;
        Lift { number, ended_ns: 0, carried_s, mass_kg, distance_m, damage, undone: u64::from(undone) }
    }
}

/// [`Handover`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HandoverPart {
    /// Relative to the feet, m.
    place_m: [f64; 3],
    /// Measured over predicted limit ratio, minus one.
    excess: f64,
    /// 1-σ of the measurement, as a fraction of it.
    sigma: f64,
}

impl HandoverPart {
    pub(super) fn of(of: &Handover) -> HandoverPart {
        let Handover { place_m, excess, sigma } = *of;
        HandoverPart { place_m, excess, sigma }
    }

    pub(super) fn handover(&self) -> Handover {
        let HandoverPart { place_m, excess, sigma } = *self;
        Handover { place_m, excess, sigma }
    }
}

/// Rounds fatigue to the stored resolution.
pub(crate) fn recovered_fatigue(fatigue: f64) -> f64 {
    (fatigue * FATIGUE_STEPS).round() / FATIGUE_STEPS
}

impl ShiftPart {
    pub(super) fn of(shift: &Shift, saved_unix_s: u64) -> ShiftPart {
        let tired =
            Joint::ALL.iter().map(|joint| (joint.name(), recovered_fatigue(shift.fatigue[joint.index()])));
        let tired = tired.filter(|(_, fatigue)| *fatigue > 0.0);
        ShiftPart {
            saved_unix_s,
            damage: shift.damage,
            lifts: shift.lifts,
            ended: shift.ended,
            lift: shift.latest.iter().filter(|lift| lift.number > 0).map(LiftPart::of).collect(),
            fatigue: tired.map(|(name, fatigue)| (name.to_owned(), fatigue)).collect(),
        }
    }

    /// The shift to go on with at a time, s since 1970 UTC, and its age, s. The age is unknown (`None`) if the clock is
    /// behind the date of the shift, for instance before it is synchronised: a shift that may have ended goes on, so that
    /// no dose is lost.
    ///
    /// # Errors
    /// Why the shift has ended, or [`ShiftPart::check`].
    pub(super) fn shift(&self, now_unix_s: u64) -> Result<(Shift, Option<u64>), String> {
        let age_s = now_unix_s.checked_sub(self.saved_unix_s);
        if let Some(age_s) = age_s.filter(|age_s| *age_s >= SHIFT_ENDS_S) {
            return Err(format!("the last one ended {:.1} h ago", age_s as f64 / 3600.0));
        }
        Ok((self.check()?, age_s))
    }

    /// Checks all numbers; returns the shift.
    ///
    /// # Errors
    /// Which number is out of range.
    pub(super) fn check(&self) -> Result<Shift, String> {
        let &ShiftPart { damage, lifts, ended, .. } = self;
        if lifts > ended || ended > LIFTS_MAX {
            return Err(format!("its count of {lifts} lifts of {ended} is out of range"));
        }
        let mut latest = [Lift::zeroed(); LATEST_LIFTS];
        for part in &self.lift {
            let is_last = (1..=ended).contains(&part.number)
                && ended - part.number < LATEST_LIFTS as u64
                && part.lift().is_sound();
            if !is_last {
                return Err(format!("its lift {} is out of range", part.number));
            }
            latest[(part.number - 1) as usize % LATEST_LIFTS] = part.lift();
        }
        // Each unlisted lift adds a damage of 0 to 1.
        let counted = latest.iter().filter(|lift| lift.number > 0 && lift.undone == 0);
        let (listed, least) = counted.fold((0, 0.0), |(count, sum), lift| (count + 1, sum + lift.damage));
        let most = least + lifts.saturating_sub(listed) as f64;
        let rounding = DAMAGE_ROUNDING * most.max(1.0);
        if listed > lifts || !(0.0_f64.max(least - rounding)..=most + rounding).contains(&damage) {
            return Err(format!("its damage of {damage} by {lifts} lifts is out of range"));
        }
        let mut fatigue = [0.0; JOINTS];
        for (name, value) in &self.fatigue {
            let joint = Joint::named(name).ok_or_else(|| format!("there is no joint {name}"))?;
            if !(0.0..=1.0).contains(value) {
                return Err(format!("its fatigue of {name} is out of range: {value}"));
            }
            fatigue[joint.index()] = *value;
        }
        Ok(Shift { fatigue, damage, lifts, ended, latest })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_stored_by_name() {
        let all = if LIBRARY.len() == 64 { u64::MAX } else { (1 << LIBRARY.len()) - 1 };
        for bits in [0, 1, 0b1010, all] {
            assert_eq!(set_of(&names_of(bits)), bits, "two poses of one name?");
        }
        assert_eq!(set_of(&["of an older library".to_owned()]), 0);
    }

    #[test]
    fn a_shift_continues_after_a_break_or_a_clock_that_went_back_and_not_after_a_night() {
        let mut shift =
            Shift { fatigue: [0.0; JOINTS], damage: 0.01, lifts: 19, ended: 21, ..Zeroable::zeroed() };
        shift.fatigue[3] = 0.25;
        for number in 6..=21 {
            let lift =
                Lift { number, carried_s: 2.0, mass_kg: [8.0, 0.5], damage: 5e-4, ..Zeroable::zeroed() };
            shift.latest[(number - 1) as usize % LATEST_LIFTS] = lift;
        }
        shift.latest[0].undone = 1;
        let mut part = ShiftPart::of(&shift, 1_000_000);
        assert_eq!(part.shift(1_000_000 + 3600), Ok((shift, Some(3600))));
        assert!(part.shift(1_000_000 + 9 * 3600).unwrap_err().contains("9.0 h ago"));
        assert_eq!(part.shift(999_999), Ok((shift, None)));
        assert_eq!(part.shift(0), Ok((shift, None)));
        let mut other = part.clone();
        other.lift[3].number = 5;
        assert!(other.shift(1_000_000).unwrap_err().contains("lift 5"));
        part.damage = f64::NAN;
        assert!(part.shift(1_000_000).unwrap_err().contains("out of range"));
        let refusal = |change: &dyn Fn(&mut ShiftPart)| {
            let mut part = ShiftPart::of(&shift, 1_000_000);
            change(&mut part);
            part.shift(1_000_000).unwrap_err()
        };
        // 15 of the 19 lifts are listed with a damage of 5e-4 each, so the others damage at most 4.
        for damage in [0.0074, -0.01, 4.0076, f64::INFINITY] {
            let refusal = refusal(&|part| part.damage = damage);
            assert!(refusal.contains("by 19 lifts is out of range"), "{refusal}");
        }
        assert!(refusal(&|part| part.lifts = 14).contains("by 14 lifts is out of range"));
        assert!(refusal(&|part| part.lifts = 22).contains("count of 22 lifts of 21"));
        let century = refusal(&|part| part.ended = 1 << 32);
        assert!(century.contains("is out of range"), "{century}");
        assert!(refusal(&|part| part.lift[0].damage = 1.5).contains("its lift 17 is out of range"));
        assert!(refusal(&|part| part.fatigue.values_mut().for_each(|value| *value = 1.5)).contains("1.5"));
    }
}
