//! The lifts counted by the loop, with mass and distance of the load.

use equipoise_core::exposure::dose::LIFT_MIN_S;
use equipoise_core::message::{State, Validity};

use super::niosh::{Grasp, weight_limit_kg};

/// One lift. Mass and reach are means over the time in which they were valid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lift {
    /// Time of the first valid mass, s since the start of the recording; the end of the lift if there was none.
    pub from_s: f64,
    /// Time of the last valid mass, s.
    pub to_s: f64,
    /// Mass, kg; `None` if it was never valid.
    pub mass_kg: Option<f64>,
    /// Mean of its 1-σ, kg: the error within one lift does not average out.
    pub mass_sigma_kg: Option<f64>,
    /// Horizontal distance from the middle of the ankles, m.
    pub reach_m: Option<f64>,
    /// Its maximum, m.
    pub reach_max_m: Option<f64>,
    /// Recommended weight limit ([`weight_limit_kg`]), kg; 0 beyond the limits of the equation.
    pub limit_kg: Option<f64>,
}

impl Lift {
    /// Mass divided by the recommended weight limit; `None` without one.
    pub fn index(&self) -> Option<f64> {
        Some(self.mass_kg? / self.limit_kg.filter(|limit_kg| *limit_kg > 0.0)?)
    }

    /// As [`Lift::index`], but infinite outside the range of the equation, where no mass is acceptable.
    pub fn excess(&self) -> Option<f64> {
        match self.limit_kg? {
            limit_kg if limit_kg <= 0.0 => Some(f64::INFINITY),
            _ => self.index(),
        }
    }
}

/// All lifts of a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lifts {
    /// Lifts that ended within the recording, in order.
    pub lifts: Vec<Lift>,
    /// Number of lifts counted before the recording.
    pub before: u32,
    counted: Option<u32>,
    /// Number of lifts of earlier subjects.
    of_others: usize,
    episode: Episode,
    /// Height of the walking surface in the world, m.
    surface_z_m: f64,
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Episode {
    span_s: Option<[f64; 2]>,
    masses: f64,
    mass_sum_kg: f64,
    sigma_sum_kg: f64,
    reaches: f64,
    reach_sum_m: f64,
    reach_max_m: f64,
    empty_s: f64,
    /// The first and the last grasp of a load with valid torques.
    ends: Option<[Grasp; 2]>,
}

impl Lifts {
    /// Without lifts, on a walking surface at this height in the world, m.
    pub fn on(surface_z_m: f64) -> Lifts {
        Lifts { surface_z_m, ..Lifts::default() }
    }

    /// Adds one state, which represents `step_s`.
    pub fn ingest(&mut self, state: &State, time_s: f64, step_s: f64) {
        let counted = self.counted.unwrap_or_else(|| {
            self.before = state.lifts;
            state.lifts
        });
        for _ in counted..state.lifts {
            self.lifts.push(std::mem::take(&mut self.episode).lift(time_s));
        }
        // Undone, or lost by a restart of the daemon: no longer part of the dose.
        let undone = counted.saturating_sub(state.lifts) as usize;
        self.lifts.truncate(self.lifts.len().saturating_sub(undone).max(self.of_others));
        self.counted = Some(state.lifts);
        self.episode.ingest(state, time_s, step_s, self.surface_z_m);
    }

    /// From this state on another subject is in use, with a separate count of lifts and empty hands.
    pub fn change_subject(&mut self, state: &State) {
        self.counted = Some(state.lifts);
        self.of_others = self.lifts.len();
        self.episode = Episode::default();
    }

    /// Whether a load was carried at the end.
    pub fn under_way(&self) -> bool {
        self.episode.span_s.is_some_and(|[from_s, to_s]| to_s - from_s >= LIFT_MIN_S)
    }
}

impl Episode {
    fn ingest(&mut self, state: &State, time_s: f64, step_s: f64, surface_z_m: f64) {
        let valid_kg = state.unless(Validity::INVALIDATES_LIFTED_MASS, state.lifted_mass_kg);
        // A negative mass indicates leaning on something: no load, as in the loop.
        if let Some(mass_kg) = valid_kg.filter(|mass_kg| *mass_kg > 0.0) {
            // After this time without a load the loop has ended the episode: as a lift, which was taken, or as a brief
            // contact.
            if self.empty_s >= LIFT_MIN_S {
                *self = Episode::default();
            }
            let [from_s, _] = self.span_s.unwrap_or([time_s; 2]);
            self.span_s = Some([from_s, time_s]);
            self.masses += 1.0;
            self.mass_sum_kg += mass_kg;
            self.sigma_sum_kg += state.lifted_mass_sigma_kg;
            self.empty_s = 0.0;
            self.ingest_grasp(state, surface_z_m);
        } else if valid_kg.is_some() || state.valid == Validity::BELOW_LOAD_THRESHOLD.0 {
            self.empty_s += step_s;
        }
        // A lift that the loop counted was taken before.
        if self.empty_s > 2.0 * LIFT_MIN_S {
            *self = Episode::default();
        }
    }

    /// Adds the position of a load.
    fn ingest_grasp(&mut self, state: &State, surface_z_m: f64) {
        if let Some(reach_m) = state.unless(Validity::INVALIDATES_TORQUES, state.reach_m) {
            self.reaches += 1.0;
            self.reach_sum_m += reach_m;
            self.reach_max_m = self.reach_max_m.max(reach_m);
        }
        if let Some(grasp) = Grasp::of(state, surface_z_m) {
            let [first, _] = self.ends.unwrap_or([grasp; 2]);
            self.ends = Some([first, grasp]);
        }
    }

    fn lift(self, time_s: f64) -> Lift {
        let mean = |sum: f64, count: f64| (count > 0.0).then(|| sum / count);
        let [from_s, to_s] = self.span_s.unwrap_or([time_s; 2]);
        Lift {
            from_s,
            to_s,
            mass_kg: mean(self.mass_sum_kg, self.masses),
            mass_sigma_kg: mean(self.sigma_sum_kg, self.masses),
            reach_m: mean(self.reach_sum_m, self.reaches),
            reach_max_m: (self.reaches > 0.0).then_some(self.reach_max_m),
            limit_kg: self.ends.map(weight_limit_kg),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_lift_is_counted_by_the_loop_and_a_touch_is_not() {
        let mut lifts = Lifts::default();
        let mut time_s = 0.0;
        let mut take = |seconds: f64, state: State| {
            for _ in 0..(seconds * 100.0) as usize {
                time_s += 0.01;
                lifts.ingest(&state, time_s, 0.01);
            }
        };
        let counted = |lifts| State { lifts, valid: Validity::BELOW_LOAD_THRESHOLD.0, ..State::zeroed() };
        let carrying = |mass_kg, lifts| State {
            lifted_mass_kg: mass_kg,
            lifted_mass_sigma_kg: 0.3,
            reach_m: 0.4,
            lifts,
            ..State::zeroed()
        };
        take(1.0, counted(2));
        take(0.2, carrying(50.0, 2));
        take(2.0, counted(2));
        take(3.0, State { reach_m: 0.9, ..carrying(-8.0, 2) });
        take(1.0, carrying(4.0, 2));
        take(1.0, carrying(6.0, 2));
        // Without a load there is no reach, although torques may be valid.
        take(0.2, State { reach_m: 0.9, ..carrying(0.0, 2) });
        take(0.5, counted(2));
        take(1.0, counted(3));
        take(1.0, carrying(9.0, 3));
        assert!(lifts.under_way());
        let [lift] = lifts.lifts[..] else { panic!("{lifts:?}") };
        assert_eq!(lifts.before, 2);
        assert!(
            (lift.mass_kg.unwrap() - 5.0).abs() < 1e-9 && (lift.mass_sigma_kg.unwrap() - 0.3).abs() < 1e-9
        );
        assert!((lift.reach_m.unwrap() - 0.4).abs() < 1e-9 && lift.reach_max_m == Some(0.4));
        assert!((lift.to_s - lift.from_s - 1.99).abs() < 1e-6);
    }

    #[test]
    fn an_undone_lift_is_not_counted() {
        let mut lifts = Lifts::default();
        let counted = |lifts| State { lifts, valid: Validity::BELOW_LOAD_THRESHOLD.0, ..State::zeroed() };
        for (index, count) in [1, 2, 3, 2, 3].into_iter().enumerate() {
            lifts.ingest(&counted(count), f64::from(index as u32), 0.01);
        }
        assert_eq!(lifts.lifts.iter().map(|lift| lift.to_s).collect::<Vec<_>>(), [1.0, 4.0]);
        // A restored lift of the next subject is undone; those of this one remain.
        lifts.change_subject(&counted(5));
        for count in [5, 6, 5, 4] {
            lifts.ingest(&counted(count), 9.0, 0.01);
        }
        assert_eq!(lifts.lifts.len(), 2);
    }

    #[test]
    fn a_contact_half_a_second_before_a_lift_is_not_part_of_it() {
        let mut lifts = Lifts::default();
        let mut take = |seconds: f64, state: State| {
            (0..(seconds * 100.0) as usize).for_each(|_| lifts.ingest(&state, 1.0, 0.01));
        };
        let empty = |lifts| State { lifts, valid: Validity::BELOW_LOAD_THRESHOLD.0, ..State::zeroed() };
        let carrying = |lifted_mass_kg| State { lifted_mass_kg, ..State::zeroed() };
        take(0.3, carrying(15.0));
        take(0.7, empty(0));
        take(1.0, carrying(5.0));
        take(0.5, empty(0));
        take(0.1, empty(1));
        assert_eq!(lifts.lifts.iter().map(|lift| lift.mass_kg).collect::<Vec<_>>(), [Some(5.0)]);
    }

    #[test]
    fn a_lift_without_valid_values_has_no_mass() {
        let mut lifts = Lifts::default();
        let hidden = State { valid: Validity::MOVING.0, lifted_mass_kg: 7.0, ..State::zeroed() };
        lifts.ingest(&hidden, 0.0, 0.01);
        lifts.ingest(&State { lifts: 1, ..hidden }, 0.01, 0.01);
        assert_eq!(lifts.lifts.len(), 1);
        assert_eq!((lifts.lifts[0].mass_kg, lifts.lifts[0].reach_m), (None, None));
    }
}
