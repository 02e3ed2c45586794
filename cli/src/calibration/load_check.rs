//! Compares published joint torques with those of a known mass held above known points of the floor.
//!
//! A mass m at rest above the point a requires the moment `(a − o) × m g ẑ` at L5/S1, with o the position of the joint.
//! Both shoulders together, and both elbows together, carry the same moment about the midpoint between them if the
//! hands hold the mass symmetrically, whatever the hand load fractions; both hips together carry the opposite moment,
//! whatever the foot load fractions. So four expected moments follow from the mass and tape measurements alone; the
//! joint positions are the suit's on both sides.

use equipoise_core::body::Joint;
use equipoise_core::message::{State, Validity};
use nalgebra::Vector3;

/// Duration of empty hands before a trial begins, s.
const EMPTY_S: f64 = 1.0;
/// Duration of holding before the measurement begins, s: averages over a carry assume errors correlated over 2 s.
const SETTLE_S: f64 = 2.0;
/// A longer gap between two states restarts the interval of empty hands and is not part of a measurement, s.
const GAP_S: f64 = 0.2;
/// A lifted mass below this fraction of the mass does not count as the mass.
const LIFTED_RATIO: f64 = 0.5;

/// Joints that carry the load together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Group {
    /// Published name.
    pub name: &'static str,
    joints: &'static [&'static str],
    /// 1 for joints between the load and the pelvis, −1 for those below.
    sign: f64,
}

/// The groups compared.
pub const GROUPS: [Group; 4] = [
    Group { name: "L5S1", joints: &["L5S1"], sign: 1.0 },
    Group { name: "shoulders", joints: &["LeftShoulder", "RightShoulder"], sign: 1.0 },
    Group { name: "elbows", joints: &["LeftElbow", "RightElbow"], sign: 1.0 },
    Group { name: "hips", joints: &["LeftHip", "RightHip"], sign: -1.0 },
];

/// Means over a trial, along the direction of the expected moment, N m.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Comparison {
    /// Expected from mass and position.
    pub expected_nm: f64,
    /// Published; left and right added.
    pub published_nm: f64,
    /// Sum of the published 1-σ: an upper bound for a sum.
    pub sigma_nm: f64,
}

impl Comparison {
    /// Published minus expected, N m.
    pub fn error_nm(&self) -> f64 {
        self.published_nm - self.expected_nm
    }

    /// Error divided by its 1-σ.
    pub fn sigmas(&self) -> f64 {
        self.error_nm() / self.sigma_nm
    }

    fn plus(self, other: Comparison) -> Comparison {
        Comparison {
            expected_nm: self.expected_nm + other.expected_nm,
            published_nm: self.published_nm + other.published_nm,
            sigma_nm: self.sigma_nm + other.sigma_nm,
        }
    }

    fn times(self, factor: f64) -> Comparison {
        Comparison {
            expected_nm: factor * self.expected_nm,
            published_nm: factor * self.published_nm,
            sigma_nm: factor * self.sigma_nm,
        }
    }
}

impl Group {
    /// Published torque of a state and the expected torque of the mass above `at_m` (world x and y, m).
    fn compare(&self, state: &State, at_m: [f64; 2], weight_n: f64) -> Option<Comparison> {
        let count = self.joints.len() as f64;
        let (mut middle_m, mut torque_nm, mut sigma_nm) = (Vector3::zeros(), Vector3::zeros(), 0.0);
        for joint in self.joints.iter().filter_map(|name| Joint::named(name)) {
            middle_m += Vector3::from(state.segment_origin_m[joint.segment().index()]) / count;
            torque_nm += Vector3::from(state.torque_nm[joint.index()]);
            sigma_nm += state.torque_sigma_nm[joint.index()];
        }
        let arm_m = Vector3::new(at_m[0] - middle_m.x, at_m[1] - middle_m.y, 0.0);
        let expected_nm = arm_m.cross(&Vector3::z()) * (self.sign * weight_n);
        let direction = expected_nm.try_normalize(1e-6)?;
        Some(Comparison {
            expected_nm: expected_nm.norm(),
            published_nm: torque_nm.dot(&direction),
            sigma_nm,
        })
    }
}

/// Settings of the load check.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadCheckSettings {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Gravity on site, m/s².
    pub gravity_m_per_s2: f64,
    /// Averaging time, s.
    pub seconds: f64,
    /// Points of the floor below the mass, world x and y, m; one trial for each.
    pub at_m: Vec<[f64; 2]>,
}

/// One trial.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Point below the mass, world x and y, m.
    pub at_m: [f64; 2],
    /// Mean of the published lifted mass, kg.
    pub mass_kg: f64,
    /// Mean of its 1-σ, kg.
    pub mass_sigma_kg: f64,
    /// In the order of [`GROUPS`]; `None` for joints directly above the point.
    pub groups: [Option<Comparison>; GROUPS.len()],
}

/// Progress of the check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// The hands are empty: the mass can be lifted for the trial with this number.
    Ready(usize),
    /// The mass is held and measured.
    Measuring,
    /// The trial is over; the mass can be put down.
    Measured,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Empty { for_s: f64 },
    Held { for_s: f64 },
}

/// The guided load check.
#[derive(Debug)]
pub struct LoadCheck {
    settings: LoadCheckSettings,
    phase: Phase,
    newest_ns: u64,
    trial: Trial,
    averaged_s: f64,
    trials: Vec<Trial>,
}

impl LoadCheck {
    /// Begins with the hands empty.
    pub fn new(settings: LoadCheckSettings) -> LoadCheck {
        let trial = Trial { at_m: [0.0; 2], mass_kg: 0.0, mass_sigma_kg: 0.0, groups: [None; GROUPS.len()] };
        let phase = Phase::Empty { for_s: 0.0 };
        LoadCheck { settings, phase, newest_ns: 0, trial, averaged_s: 0.0, trials: Vec::new() }
    }

    /// The trials completed so far.
    pub fn trials(&self) -> &[Trial] {
        &self.trials
    }

    /// Whether all trials are complete.
    pub fn is_done(&self) -> bool {
        self.trials.len() >= self.settings.at_m.len()
    }

    /// Ingests a state; repeated suit samples are ignored.
    pub fn ingest(&mut self, state: &State) -> Option<Event> {
        if state.suit_sample_time_ns <= self.newest_ns || self.is_done() {
            return None;
        }
        let step_s = (state.suit_sample_time_ns - self.newest_ns) as f64 * 1e-9;
        let is_gap = step_s > GAP_S;
        self.newest_ns = state.suit_sample_time_ns;
        let valid = state.validity();
        match self.phase {
            Phase::Empty { for_s } => {
                let is_empty = valid.any_of(Validity::BELOW_LOAD_THRESHOLD) && !is_gap;
                let for_s = if is_empty { for_s + step_s } else { 0.0 };
                self.phase = Phase::Empty { for_s };
                if for_s < EMPTY_S {
                    return None;
                }
                self.phase = Phase::Held { for_s: 0.0 };
                Some(Event::Ready(self.trials.len()))
            }
            Phase::Held { for_s } => {
                let is_published = !valid.any_of(Validity::INVALIDATES_TORQUES);
                let is_light = is_published && state.lifted_mass_kg <= LIFTED_RATIO * self.settings.mass_kg;
                if is_light || valid.any_of(Validity::BELOW_LOAD_THRESHOLD) {
                    self.phase = Phase::Held { for_s: 0.0 };
                    return None;
                }
                // An interruption, as of a sensor or of a busy computer, does not restart the measurement.
                if !is_published || is_gap {
                    return None;
                }
                let now_s = for_s + step_s;
                self.phase = Phase::Held { for_s: now_s };
                self.measure(state, for_s, now_s, step_s)
            }
        }
    }

    fn measure(&mut self, state: &State, before_s: f64, now_s: f64, step_s: f64) -> Option<Event> {
        if now_s < SETTLE_S {
            return None;
        }
        if before_s < SETTLE_S {
            self.trial = Trial { groups: [Some(Comparison::default()); GROUPS.len()], ..self.trial.clone() };
            self.trial.at_m = self.settings.at_m[self.trials.len()];
            (self.trial.mass_kg, self.trial.mass_sigma_kg, self.averaged_s) = (0.0, 0.0, 0.0);
            return Some(Event::Measuring);
        }
        self.averaged_s += step_s;
        self.trial.mass_kg += step_s * state.lifted_mass_kg;
        self.trial.mass_sigma_kg += step_s * state.lifted_mass_sigma_kg;
        let weight_n = self.settings.mass_kg * self.settings.gravity_m_per_s2;
        for (group, sum) in GROUPS.iter().zip(&mut self.trial.groups) {
            let comparison = group.compare(state, self.trial.at_m, weight_n);
            *sum = sum.zip(comparison).map(|(sum, comparison)| sum.plus(comparison.times(step_s)));
        }
        if self.averaged_s < self.settings.seconds {
            return None;
        }
        let per_s = 1.0 / self.averaged_s;
        self.trial.mass_kg *= per_s;
        self.trial.mass_sigma_kg *= per_s;
        self.trial.groups = self.trial.groups.map(|group| group.map(|sum| sum.times(per_s)));
        self.trials.push(self.trial.clone());
        self.phase = Phase::Empty { for_s: 0.0 };
        Some(Event::Measured)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    const SETTINGS: fn() -> LoadCheckSettings = || LoadCheckSettings {
        mass_kg: 10.0,
        gravity_m_per_s2: 10.0,
        seconds: 1.0,
        at_m: vec![[0.5, 0.0], [0.3, 0.0]],
    };

    fn state(time_s: f64, load_kg: f64) -> State {
        let mut state: State = Zeroable::zeroed();
        state.suit_sample_time_ns = 1_000_000_000 + (time_s * 1e9) as u64;
        if load_kg < 1.0 {
            state.valid = Validity::BELOW_LOAD_THRESHOLD.0;
        }
        (state.lifted_mass_kg, state.lifted_mass_sigma_kg) = (load_kg, 0.2);
        // 0.4 m in front of L5/S1 and of the hips: 40 N m about −y, and the opposite in both hips together.
        for (name, x, torque_nm) in
            [("L5S1", 0.1, -41.0), ("LeftHip", 0.1, 12.0), ("RightHip", 0.1, 26.0), ("LeftElbow", 0.5, 0.0)]
        {
            let joint = Joint::named(name).unwrap();
            state.segment_origin_m[joint.segment().index()] = [x, 0.0, 1.0];
            state.torque_nm[joint.index()] = [3.0, torque_nm, 0.0];
            state.torque_sigma_nm[joint.index()] = 2.0;
        }
        let right = Joint::named("RightElbow").unwrap().segment().index();
        state.segment_origin_m[right] = [0.5, 0.0, 1.0];
        state
    }

    #[test]
    fn each_trial_starts_with_empty_hands_and_compares_along_the_expected_moment() {
        let mut check = LoadCheck::new(SETTINGS());
        let mut events = Vec::new();
        for tick in 0..1200 {
            let time_s = f64::from(tick) * 0.01;
            let load_kg = if (2.0..6.0).contains(&time_s) || time_s > 8.0 { 10.2 } else { 0.0 };
            events.extend(check.ingest(&state(time_s, load_kg)));
        }
        let trial = [Event::Measuring, Event::Measured];
        assert_eq!(events, [&[Event::Ready(0)], &trial[..], &[Event::Ready(1)], &trial[..]].concat());
        assert!(check.is_done());
        let [first, second] = check.trials() else { panic!("{:?}", check.trials()) };
        assert!((first.mass_kg - 10.2).abs() < 1e-9 && (first.mass_sigma_kg - 0.2).abs() < 1e-9);
        let [spine, _, elbows, hips] = first.groups;
        let (spine, hips) = (spine.unwrap(), hips.unwrap());
        assert!(
            (spine.expected_nm - 40.0).abs() < 1e-9 && (spine.error_nm() - 1.0).abs() < 1e-9,
            "{spine:?}"
        );
        assert!((hips.expected_nm - 40.0).abs() < 1e-9 && (hips.error_nm() + 2.0).abs() < 1e-9, "{hips:?}");
        assert!((hips.sigmas() + 0.5).abs() < 1e-9, "{hips:?}");
        assert_eq!(elbows, None, "right above the point");
        assert!((second.groups[0].unwrap().expected_nm - 20.0).abs() < 1e-9, "{second:?}");
    }

    #[test]
    fn putting_the_mass_down_restarts_the_trial_and_an_interruption_does_not() {
        let mut check = LoadCheck::new(SETTINGS());
        let mut measured = 0;
        for tick in 0..2000 {
            let time_s = f64::from(tick) * 0.01;
            let is_gap = (12.0..12.5).contains(&time_s);
            // Each hold lasts 2.5 s: long enough to settle, too short to complete the measurement.
            let load_kg = if (time_s % 3.5) > 1.0 { 10.0 } else { 0.0 };
            if !is_gap && check.ingest(&state(time_s, load_kg)) == Some(Event::Measured) {
                measured += 1;
            }
        }
        assert_eq!((measured, check.trials().len()), (0, 0));
        // From now on the mass is held; of each second, half is a gap and a tenth invalid.
        for tick in 2200..3400 {
            let (time_s, tenth) = (f64::from(tick) * 0.01, tick / 10 % 10);
            let mut state = state(time_s, 10.0);
            state.valid = if tenth == 7 { Validity::SUIT_STALE.0 } else { 0 };
            if tenth > 4 {
                check.ingest(&state);
            }
        }
        assert_eq!(check.trials().len(), 1);
    }
}
