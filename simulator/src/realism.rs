//! Deviations of a real station from an ideal one: each phenomenon is a switch with a named severity.
//!
//! Sizes are those measured on recordings of people who lift (box of 11.3 kg, four subjects) and on logs of devices.
//! `realistic` is a typical station, `severe` about twice that; `ideal` is for tests of the equations alone.

use std::str::FromStr;

use crate::feet::{FeetChange, FeetHabits};
use crate::motion::Habits;
use crate::noise::{SuitNoise, ZeroDrift};
use crate::random::Random;

/// How strong a phenomenon is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// Absent.
    Ideal,
    /// As measured at typical stations.
    Realistic,
    /// Twice that.
    Severe,
}

impl Severity {
    /// All, with their public names.
    pub const NAMES: [(&'static str, Severity); 3] =
        [("ideal", Severity::Ideal), ("realistic", Severity::Realistic), ("severe", Severity::Severe)];

    /// Factor on a phenomenon's measured size.
    pub fn factor(self) -> f64 {
        match self {
            Severity::Ideal => 0.0,
            Severity::Realistic => 1.0,
            Severity::Severe => 2.0,
        }
    }
}

/// Severity of every phenomenon of the simulated person and of the sensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Realism {
    /// Each foot has its own, changing pressure point (1-σ): 20 mm ahead of or behind the line common to both, while
    /// both carry the same force, and 7 mm sideways.
    pub feet: Severity,
    /// Without the load the feet divide the ground reaction of the same motion otherwise than balance and `feet` alone
    /// determine: at a load of 11.3 kg, and in proportion to it, 0.02 (1-σ) of the vertical force is on the other foot,
    /// the pressure points are 5 mm farther ahead and behind, and 2 mm farther apart. A tenth (1-σ) of the horizontal
    /// force, and of the free moment, is on the other foot, with the load and without it. Assumed: never measured,
    /// because no person repeats a motion exactly without its load.
    pub feet_change: Severity,
    /// The hands are 0.30 to 0.45 m apart on a box, and carry unequal fractions of it: the right one between 0 and
    /// 100 %. And each has its own grip point: along the hand from the palm's hollow to the middle of the first phalanges
    /// (21 mm before to 21 mm beyond the knuckles), 5 to 25 mm on the palm's side of the hand's middle, and up to 12 mm
    /// off its axis.
    pub hands: Severity,
    /// The centre of a box is 22 to 42 mm beyond the grips, away from the body: 83 to 103 mm ahead of the wrists and 40
    /// to 50 mm beyond the hands' centres of mass were measured, so the hands sloped by 45° and the knuckles were 61 mm
    /// ahead.
    pub load_place: Severity,
    /// Hands squeeze a box between them. `severe` is a box without handles: its weight over 2 µ on each hand, µ = 0.5;
    /// [`Realism::REALISTIC`] boxes have handles and are not squeezed.
    pub squeeze: Severity,
    /// The suit's reported bones change length with the posture ([`SuitNoise::REALISTIC`]).
    pub soft_tissue: Severity,
    /// The suit's world drifts relative to the plate's: 30 mm (1-σ) along each horizontal axis.
    pub suit_world: Severity,
    /// The plate's stamps are 43 to 139 ms late and drift by −228 to −555 ppm; the suit's true rate is up to 0.1 % off.
    pub clocks: Severity,
    /// The plate's zero drifts by up to 0.01 N/s in each force component from the last reset on ([`ZeroDrift`]).
    pub plate_zero: Severity,
}

/// Errors between the sensors' clocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clocks {
    /// Initial delay of the stamps of the plate's samples, s.
    pub plate_late_s: f64,
    /// Rate of the plate's clock relative to the suit's, ppm; positive if fast.
    pub plate_drift_ppm: f64,
    /// Deviation of the suit's sample rate from its nominal rate, ppm.
    pub suit_rate_ppm: f64,
}

impl Realism {
    /// No phenomenon.
    pub const IDEAL: Realism = Realism::all(Severity::Ideal);
    /// A typical station: the default of the studies; contacts and soft tissue also of the simulated person on the
    /// wires.
    pub const REALISTIC: Realism = Realism { squeeze: Severity::Ideal, ..Realism::all(Severity::Realistic) };
    /// Everything at its worst.
    pub const SEVERE: Realism = Realism::all(Severity::Severe);

    const fn all(severity: Severity) -> Realism {
        Realism {
            feet: severity,
            feet_change: severity,
            hands: severity,
            load_place: severity,
            squeeze: severity,
            soft_tissue: severity,
            suit_world: severity,
            clocks: severity,
            plate_zero: severity,
        }
    }

    /// Names of the switches.
    pub const SWITCHES: [&'static str; 9] = [
        "feet",
        "feet_change",
        "hands",
        "load_place",
        "squeeze",
        "soft_tissue",
        "suit_world",
        "clocks",
        "plate_zero",
    ];

    fn switch(&mut self, name: &str) -> Option<&mut Severity> {
        match name {
            "feet" => Some(&mut self.feet),
            "feet_change" => Some(&mut self.feet_change),
            "hands" => Some(&mut self.hands),
            "load_place" => Some(&mut self.load_place),
            "squeeze" => Some(&mut self.squeeze),
            "soft_tissue" => Some(&mut self.soft_tissue),
            "suit_world" => Some(&mut self.suit_world),
            "clocks" => Some(&mut self.clocks),
            "plate_zero" => Some(&mut self.plate_zero),
            _ => None,
        }
    }

    /// Habits of the person with this seed: [`Habits::ORDINARY`] with the contact phenomena.
    pub fn habits(&self, seed: u64) -> Habits {
        let mut random = Random::new(seed, "hands");
        let right_hand_fraction = 0.5 + self.hands.factor().min(1.0) * (random.between(0.0, 1.0) - 0.5);
        let mut random = Random::new(seed, "box width");
        let hands_apart_m =
            Habits::ORDINARY.hands_apart_m + self.hands.factor().min(1.0) * random.between(-0.075, 0.075);
        let mut random = Random::new(seed, "grips");
        let grip_off_m = std::array::from_fn(|_| {
            [random.between(-0.012, 0.012), random.between(-0.021, 0.021), random.between(-0.025, -0.005)]
                .map(|metres| self.hands.factor() * metres)
        });
        let mut random = Random::new(seed, "load place");
        let load_ahead_m = self.load_place.factor() * random.between(0.022, 0.042);
        Habits {
            hands_apart_m,
            right_hand_fraction,
            feet: self.feet_habits(),
            grip_off_m,
            load_ahead_m,
            squeeze_ratio: 0.5 * self.squeeze.factor(),
            ..Habits::ORDINARY
        }
    }

    fn feet_habits(&self) -> FeetHabits {
        let [ahead_m, aside_m] = [0.020, 0.007].map(|sigma_m| self.feet.factor() * sigma_m);
        let change = self.feet_change.factor();
        FeetHabits {
            ahead_m,
            aside_m,
            change: FeetChange { fraction: change * 0.02, ahead_m: change * 0.005, aside_m: change * 0.002 },
            shear: change * 0.1,
        }
    }

    /// An ordinary suit on this body.
    pub fn suit_noise(&self) -> SuitNoise {
        let SuitNoise { soft_tissue_m_per_rad, drift_m, .. } = SuitNoise::REALISTIC;
        SuitNoise {
            soft_tissue_m_per_rad: self.soft_tissue.factor() * soft_tissue_m_per_rad,
            drift_m: drift_m.map(|sigma_m| self.suit_world.factor() * sigma_m),
            ..SuitNoise::ORDINARY
        }
    }

    /// Drift of the zero of the first plate (0) or the second at the station with this seed.
    pub fn zero_drift(&self, seed: u64, plate: u32) -> ZeroDrift {
        ZeroDrift::new(self.plate_zero.factor(), seed, plate)
    }

    /// Clocks of the station with this seed.
    pub fn clocks(&self, seed: u64) -> Clocks {
        let mut random = Random::new(seed, "clocks");
        let factor = self.clocks.factor();
        Clocks {
            plate_late_s: factor * random.between(0.043, 0.139),
            plate_drift_ppm: factor * random.between(-555.0, -228.0),
            suit_rate_ppm: factor * random.between(-1000.0, 1000.0),
        }
    }
}

impl FromStr for Realism {
    type Err = String;

    /// `realistic`, or that followed by changes: `realistic,feet=ideal,squeeze=severe`.
    fn from_str(text: &str) -> Result<Realism, String> {
        let mut parts = text.split(',');
        let severity = |name: &str| {
            let found = Severity::NAMES.iter().find(|(known, _)| *known == name);
            found
                .map(|(_, severity)| *severity)
                .ok_or_else(|| format!("no severity is called `{name}`: use ideal, realistic or severe"))
        };
        let mut realism = match severity(parts.next().unwrap_or_default())? {
            Severity::Ideal => Realism::IDEAL,
            Severity::Realistic => Realism::REALISTIC,
            Severity::Severe => Realism::SEVERE,
        };
        for part in parts {
            let (name, value) =
                part.split_once('=').ok_or_else(|| format!("`{part}`: expected PHENOMENON=SEVERITY"))?;
            let value = severity(value)?;
            let switch = realism.switch(name).ok_or_else(|| {
                format!("no phenomenon is called `{name}`: use one of {}", Realism::SWITCHES.join(", "))
            })?;
            *switch = value;
        }
        Ok(realism)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_switch_can_be_set_by_name_and_an_unknown_one_is_named() {
        for name in Realism::SWITCHES {
            let mut expected = Realism::IDEAL;
            *expected.switch(name).unwrap() = Severity::Severe;
            assert_eq!(format!("ideal,{name}=severe").parse(), Ok(expected), "{name}");
        }
        assert_eq!("realistic".parse(), Ok(Realism::REALISTIC));
        assert!(Realism::from_str("realistic,foot=ideal").unwrap_err().contains("foot"));
        assert!(Realism::from_str("real").unwrap_err().contains("real"));
    }

    #[test]
    fn sizes_are_those_of_the_measurements() {
        let mut apart = [f64::MAX, f64::MIN];
        for seed in 0..100 {
            let habits = Realism::REALISTIC.habits(seed);
            assert!((0.022..0.042).contains(&habits.load_ahead_m) && habits.squeeze_ratio == 0.0);
            assert!((0.30..0.45).contains(&habits.hands_apart_m), "{habits:?}");
            apart = [apart[0].min(habits.right_hand_fraction), apart[1].max(habits.right_hand_fraction)];
            for [across_m, along_m, palmar_m] in habits.grip_off_m {
                assert!(across_m.abs() <= 0.012 && along_m.abs() <= 0.021, "{habits:?}");
                assert!((-0.025..=-0.005).contains(&palmar_m), "{habits:?}");
            }
            assert_eq!(Realism::IDEAL.habits(seed), Habits::ORDINARY);
            let clocks = Realism::REALISTIC.clocks(seed);
            assert!((0.043..0.139).contains(&clocks.plate_late_s) && clocks.suit_rate_ppm.abs() < 1000.0);
            assert!((-555.0..-228.0).contains(&clocks.plate_drift_ppm), "{clocks:?}");
            let exact = Realism::IDEAL.clocks(seed);
            assert_eq!([exact.plate_late_s, exact.plate_drift_ppm, exact.suit_rate_ppm], [0.0; 3]);
            let drifts = [0, 1].map(|plate| Realism::REALISTIC.zero_drift(seed, plate));
            assert_ne!(drifts[0], drifts[1]);
            for drift in drifts.map(|drift| drift.at(100.0)) {
                assert!(drift.force_n.amax() <= 2.0 && drift.moment_nm.amax() <= 0.65, "{drift:?}");
            }
            assert_eq!(Realism::IDEAL.zero_drift(seed, 1), ZeroDrift::NONE);
        }
        let [least, most] = apart;
        assert!((0.0..0.05).contains(&least) && (0.95..=1.0).contains(&most), "{apart:?}");
        assert_eq!(Realism::REALISTIC.suit_noise(), SuitNoise::REALISTIC);
        let ideal = Realism::IDEAL.suit_noise();
        assert_eq!((ideal.soft_tissue_m_per_rad, ideal.drift_m), (0.0, [0.0; 3]));
    }
}
