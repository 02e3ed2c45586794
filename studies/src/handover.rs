//! Predicted overload of a part handed over at a place, against the overload when the person then holds it there.
//!
//! The simulated people reach by their own habits (`equipoise_simulator::reach`) and touch part and ground in their own way
//! ([`equipoise_simulator::motion::Habits`]), which are no inputs of the planner; the planner has the bones of the suit, the
//! identified mass distribution and the feet.

use std::sync::OnceLock;

use equipoise_core::body::JOINTS;
use equipoise_core::frame::{Pose, StationWorld};
use equipoise_core::handover::experience::{Experience, LimitRatio};
use equipoise_core::handover::search::{Region, SLOPES_RAD, SPACING_M, places};
use equipoise_core::handover::{self, Body, Part};
use equipoise_core::overload::TorqueLimits;
use equipoise_simulator::balance::Standing;
use equipoise_simulator::cobot::trial::{PART_KG, WIDTH_M};
use equipoise_simulator::feet::Feet;
use equipoise_simulator::motion::{BodyState, Habits, Worker};
use equipoise_simulator::person::Person;
use equipoise_simulator::random::Random;
use equipoise_simulator::reach::{Contacts, HeldPart, ReachHabits, at_rest, reach};
use equipoise_simulator::truth::hold::TrueHold;
use equipoise_simulator::truth::static_overload_nm;
use nalgebra::Vector3;

use crate::session::Session;
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tally::quartiles;

/// Maximum number of poses of the identification.
const POSES_MAX: u32 = 20;
/// Places and masses that each subject holds.
const PLACES: usize = 30;
/// Handovers measured before the prediction.
const HANDOVERS: [u32; 2] = [0, 3];
/// Range of the places, from the middle between the ankles: forward, to the left, up, m, and of the masses, kg.
const PLACE_M: Region = [[0.3, 0.6], [-0.25, 0.25], [0.6, 1.5]];
const MASS_KG: [f64; 2] = [3.0, 12.0];
/// A place is as good as the best one within this distance, m, or within this fraction of its overload.
const CLOSE_M: f64 = 0.05;
const CLOSE_FRACTION: f64 = 0.05;
/// Time between two holds: the feet press elsewhere meanwhile, s.
const BETWEEN_S: f64 = 20.0;

/// How a part is presented.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Presentation {
    /// Middle between the grips, station's world, m.
    pub at_m: Vector3<f64>,
    /// Slope of the handles ([`Part::slope_rad`]).
    pub slope_rad: Option<f64>,
}

/// Predicted and true limit ratio of the worst joint.
#[derive(Debug, Clone, Copy)]
pub struct Held {
    predicted: f64,
    sigma: f64,
    truth: f64,
}

/// Results of one subject.
#[derive(Debug, Clone)]
pub struct Findings {
    held: Vec<Held>,
    /// Places that the subject reaches and the planner calls infeasible, and the reverse.
    refused: u64,
    missed: u64,
    /// `None` if no presentation of the grid is feasible.
    best: Option<Best>,
    /// True limit ratio at the middle of the region, with turning handles; `None` if the subject does not reach it.
    ratio_at_middle: Option<f64>,
}

/// The best presentation as predicted, and the truly best one.
#[derive(Debug, Clone, Copy)]
struct Best {
    /// Distance between both, m, and whether the handles have one slope.
    off_m: f64,
    is_slope_equal: bool,
    /// True limit ratio at both.
    ratio_at_predicted: f64,
    ratio_at_best: f64,
}

impl Best {
    fn is_good(&self) -> bool {
        (self.is_slope_equal && self.off_m <= CLOSE_M)
            || self.ratio_at_predicted <= (1.0 + CLOSE_FRACTION) * self.ratio_at_best
    }
}

/// A presentation that is feasible, by the posture model alone and truly, with both limit ratios.
type Feasible = (Presentation, handover::Prediction, f64);

/// A subject who is identified, and holds parts.
struct Holder {
    body: Body,
    feet: handover::FootPlacement,
    worker: Worker,
    habits: Habits,
    reach_habits: ReachHabits,
    pressing: Feet,
    experience: Experience,
    /// Of the grid; computed when first needed, since experience does not change them.
    feasible: OnceLock<Vec<Feasible>>,
}

impl Holder {
    /// After this number of handovers.
    fn of(subject: &Subject, handovers: u32) -> Holder {
        let mut session = Session::new(subject, subject.settings());
        session.identify_by_windows(POSES_MAX);
        let habits = subject.habits();
        let worker = Worker::with_habits(subject.person(), subject.seed, habits);
        let stance = worker.stance();
        let mut holder = Holder {
            body: session.memory().identification.handover_body(session.settings(), [0.0; JOINTS]),
            feet: handover::FootPlacement {
                ankle_m: stance.ankle_m,
                world_from_foot: stance.world_from_foot,
            },
            worker,
            habits,
            reach_habits: ReachHabits::of(subject.seed),
            pressing: Feet::new(&habits.feet, subject.seed),
            experience: Experience::default(),
            feasible: OnceLock::new(),
        };
        holder.hand_over(handovers);
        holder
    }

    /// Hands parts over, each as the planner then finds most promising, and learns from each. Places that the person does
    /// not reach are left out.
    fn hand_over(&mut self, handovers: u32) {
        if handovers > 0 {
            self.feasible();
        }
        let presentations = self.feasible.get().map_or(&[][..], Vec::as_slice);
        for _ in 0..handovers {
            let lowest = |(part, model, _): &Feasible| {
                let corrected = self.experience.correct(part.at_m, model.worst_ratio);
                corrected.value - corrected.sigma
            };
            let promising = presentations.iter().min_by(|a, b| lowest(a).total_cmp(&lowest(b)));
            let Some((part, model, truth)) = promising else { return };
            let measured = LimitRatio { value: *truth, sigma: 0.0 };
            self.experience.observe(part.at_m, model.worst_ratio.value, measured);
        }
    }

    /// The feasible presentations of the grid.
    fn feasible(&self) -> &[Feasible] {
        self.feasible.get_or_init(|| {
            let all = presentations().enumerate().filter_map(|(number, part)| {
                let truth = self.true_limit_ratio(part, PART_KG, number)?;
                Some((part, self.modelled(part, PART_KG)?, truth))
            });
            all.collect()
        })
    }

    /// The worst joint's limit ratio, by the posture model alone.
    fn modelled(&self, part: Presentation, mass_kg: f64) -> Option<handover::Prediction> {
        let Presentation { at_m, slope_rad } = part;
        let part = Part { mass_kg, mass_sigma_kg: 0.0, width_m: WIDTH_M, slope_rad };
        handover::predict(&self.body, &self.feet, &part, at_m).ok()
    }

    /// The same with the experience of earlier handovers.
    fn predicted(&self, part: Presentation, mass_kg: f64) -> Option<LimitRatio> {
        let model = self.modelled(part, mass_kg)?;
        Some(self.experience.correct(part.at_m, model.worst_ratio))
    }

    /// The person who holds a part, in the hold of this number.
    fn holds(&self, part: Presentation, mass_kg: f64, number: usize) -> Option<BodyState> {
        let (person, stance) = (self.worker.person(), self.worker.stance());
        let standing = Standing { person, com_m: &person.com_m, stance, load_kg: mass_kg };
        let Presentation { at_m: middle_m, slope_rad } = part;
        let held = HeldPart { middle_m, width_m: WIDTH_M, aside: Vector3::y(), slope_rad };
        let (_, balanced) = reach(&standing, &self.reach_habits, &held)?;
        let contacts = Contacts::of(&self.habits, self.pressing.at(BETWEEN_S * number as f64));
        Some(at_rest(&standing, &balanced, &held, &contacts))
    }

    /// Largest limit ratio of a joint in that hold.
    fn true_limit_ratio(&self, part: Presentation, mass_kg: f64, number: usize) -> Option<f64> {
        let state = self.holds(part, mass_kg, number)?;
        Some(true_worst_limit_ratio(&self.body.limits, self.worker.person(), &state))
    }

    /// The best presentation of the grid; `None` if none is feasible.
    fn best(&self) -> Option<Best> {
        let feasible = self.feasible();
        let corrected =
            |(part, model, _): &Feasible| self.experience.correct(part.at_m, model.worst_ratio).value;
        let predicted = feasible.iter().min_by(|a, b| corrected(a).total_cmp(&corrected(b)))?;
        let best = feasible.iter().min_by(|a, b| a.2.total_cmp(&b.2))?;
        Some(Best {
            off_m: (predicted.0.at_m - best.0.at_m).norm(),
            is_slope_equal: predicted.0.slope_rad == best.0.slope_rad,
            ratio_at_predicted: predicted.2,
            ratio_at_best: best.2,
        })
    }
}

/// True static overload of each joint of a person at rest in this state, and the joints' limits along it, N m.
pub(crate) fn true_overload(
    limits: &TorqueLimits,
    person: &Person,
    state: &BodyState,
) -> ([Vector3<f64>; JOINTS], [f64; JOINTS]) {
    let torque_nm = static_overload_nm(person, state);
    let pose: Pose<StationWorld> = Pose::new(state.origin_m, state.world_from_segment);
    (torque_nm, limits.along_nm(&pose, &torque_nm.map(Into::into)))
}

/// Largest true limit ratio of a person at rest in this state.
fn true_worst_limit_ratio(limits: &TorqueLimits, person: &Person, state: &BodyState) -> f64 {
    let (torque_nm, limit_nm) = true_overload(limits, person, state);
    let mut hold = TrueHold::default();
    hold.add(&torque_nm, &limit_nm);
    hold.worst()
}

/// One subject's results.
pub fn findings(subject: &Subject, handovers: u32) -> Findings {
    let holder = Holder::of(subject, handovers);
    let mut random = Random::new(subject.seed, "places");
    let (mut held, mut refused, mut missed) = (Vec::new(), 0, 0);
    for number in 0..PLACES {
        let (part, mass_kg) = some_presentation(&mut random);
        match (holder.predicted(part, mass_kg), holder.true_limit_ratio(part, mass_kg, number)) {
            (Some(predicted), Some(truth)) => {
                held.push(Held { predicted: predicted.value, sigma: predicted.sigma, truth });
            }
            (None, Some(_)) => refused += 1,
            (Some(_), None) => missed += 1,
            (None, None) => {}
        }
    }
    let middle_m = Vector3::from(PLACE_M.map(|[low, high]| 0.5 * (low + high)));
    let middle = Presentation { at_m: middle_m, slope_rad: None };
    Findings {
        held,
        refused,
        missed,
        best: holder.best(),
        ratio_at_middle: holder.true_limit_ratio(middle, PART_KG, PLACES),
    }
}

/// A random place, slope of the handles (or turning ones), and mass.
fn some_presentation(random: &mut Random) -> (Presentation, f64) {
    let at_m = Vector3::from(PLACE_M.map(|[low, high]| random.between(low, high)));
    let mass_kg = random.between(MASS_KG[0], MASS_KG[1]);
    let number = random.between(0.0, 1.0 + SLOPES_RAD.len() as f64) as usize;
    (Presentation { at_m, slope_rad: SLOPES_RAD.get(number).copied() }, mass_kg)
}

/// The places in the person's middle plane.
pub(crate) fn grid() -> impl Iterator<Item = Vector3<f64>> {
    let [forward, _, up] = PLACE_M;
    places([forward, [0.0, 0.0], up])
}

/// These places with each slope of fixed handles.
fn presentations() -> impl Iterator<Item = Presentation> {
    grid().flat_map(|at_m| SLOPES_RAD.map(|slope_rad| Presentation { at_m, slope_rad: Some(slope_rad) }))
}

/// The tables.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let subjects = cohort.subjects();
    let mut table = Table::new(
        format!("Worst joint's limit ratio, at {PLACES} random places ({} subjects)", subjects.len()),
        &[
            "handovers",
            "places",
            "truth",
            "bias",
            "RMS error",
            "RMS sigma",
            "within 1 sigma %",
            "within 2 sigma %",
            "refused",
            "missed",
        ],
    );
    table.note(
        "handovers: measured before the prediction, each at the place with the lowest corrected limit ratio less sigma",
    );
    table.note("truth: mean of the largest limit ratio of a joint; handles: turning, or with a slope of 0, 30 or 60 degrees, at random");
    table.note(
        "refused: places that the person reaches and the planner calls infeasible; missed: the reverse",
    );
    let mut best = Table::new(
        format!(
            "Best place and slope for {PART_KG} kg on a grid of {SPACING_M} m ({} subjects)",
            subjects.len()
        ),
        &[
            "handovers",
            "good %",
            "off m",
            "ratio there",
            "ratio at the best",
            "ratio in the middle",
            "no feasible place",
            "middle out of reach",
        ],
    );
    best.note(
        "good: within 5 cm of the true best place with its slope, or within 5 % of its overload, of all subjects; medians of \
         true limit ratios; no feasible place, middle out of reach: subjects",
    );
    best.note("in the middle: with turning handles");
    for handovers in HANDOVERS {
        let all = map_in_parallel(&subjects, |subject| findings(subject, handovers));
        table.push(row_of_places(handovers, &all));
        best.push(row_of_best(handovers, &all));
    }
    vec![table, best]
}

fn row_of_places(handovers: u32, all: &[Findings]) -> Vec<Cell> {
    let held: Vec<Held> = all.iter().flat_map(|findings| findings.held.iter().copied()).collect();
    let mean = |of: &dyn Fn(&Held) -> f64| held.iter().map(of).sum::<f64>() / held.len() as f64;
    let within = |sigmas: f64| {
        100.0 * mean(&move |held| f64::from((held.predicted - held.truth).abs() <= sigmas * held.sigma))
    };
    vec![
        Cell::Count(handovers.into()),
        Cell::Count(held.len() as u64),
        Cell::Number(mean(&|held| held.truth)),
        Cell::Number(mean(&|held| held.predicted - held.truth)),
        Cell::Number(mean(&|held| (held.predicted - held.truth).powi(2)).sqrt()),
        Cell::Number(mean(&|held| held.sigma * held.sigma).sqrt()),
        Cell::Number(within(1.0)),
        Cell::Number(within(2.0)),
        Cell::Count(all.iter().map(|findings| findings.refused).sum()),
        Cell::Count(all.iter().map(|findings| findings.missed).sum()),
    ]
}

fn row_of_best(handovers: u32, all: &[Findings]) -> Vec<Cell> {
    let best: Vec<Best> = all.iter().filter_map(|findings| findings.best).collect();
    let middle: Vec<f64> = all.iter().filter_map(|findings| findings.ratio_at_middle).collect();
    let median = |values: Vec<f64>| Cell::from(quartiles(values).map(|[_, median, _]| median));
    let of_best = |of: fn(&Best) -> f64| median(best.iter().map(of).collect());
    let without = |count: usize| Cell::Count((all.len() - count) as u64);
    let good = best.iter().filter(|best| best.is_good()).count() as f64 / all.len() as f64;
    vec![
        Cell::Count(handovers.into()),
        Cell::Number(100.0 * good),
        of_best(|best| best.off_m),
        of_best(|best| best.ratio_at_predicted),
        of_best(|best| best.ratio_at_best),
        median(middle.clone()),
        without(best.len()),
        without(middle.len()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use equipoise_core::body::Side;
    use equipoise_simulator::realism::Realism;

    #[test]
    fn predictions_are_as_sure_as_they_say_and_three_handovers_find_a_good_place() {
        let subjects: Vec<Subject> = (700..708).map(Subject::random).collect();
        let all = map_in_parallel(&subjects, |subject| findings(subject, 3));
        let held: Vec<&Held> = all.iter().flat_map(|findings| &findings.held).collect();
        let within =
            held.iter().filter(|held| (held.predicted - held.truth).abs() < 2.0 * held.sigma).count();
        assert!(within as f64 > 0.85 * held.len() as f64, "{within} of {}", held.len());
        let is_relieved = |findings: &&Findings| {
            let both = findings.best.zip(findings.ratio_at_middle);
            both.is_some_and(|(best, middle)| best.ratio_at_predicted < 0.8 * middle)
        };
        let relieved = all.iter().filter(is_relieved).count();
        assert!(relieved >= 7 && all.len() == 8, "{relieved} of {}: {all:?}", all.len());
    }

    #[test]
    fn the_truth_has_the_contacts_of_the_subject() {
        let subject = (700..)
            .map(Subject::random)
            .find(|subject| (subject.habits().right_hand_fraction - 0.5).abs() > 0.3);
        let subject = subject.unwrap();
        let state_of = |subject: &Subject| {
            let part = Presentation { at_m: Vector3::new(0.4, 0.0, 1.0), slope_rad: Some(0.5) };
            Holder::of(subject, 0).holds(part, PART_KG, 1).unwrap()
        };
        let state = state_of(&subject);
        let habits = subject.habits();
        assert_eq!(state.right_hand_fraction, habits.right_hand_fraction);
        assert!((state.load_ahead_m.norm() - habits.load_ahead_m).abs() < 1e-12);
        assert!(state.feet.ahead_m.abs() > 1e-4, "{:?}", state.feet);
        let ideal = state_of(&Subject { realism: Realism::IDEAL, ..subject });
        assert_eq!((ideal.right_hand_fraction, ideal.load_ahead_m), (0.5, Vector3::zeros()));
        let hand = Side::Left.hand().index();
        let grip_m = |state: &BodyState| {
            state.world_from_segment[hand].inverse() * (state.grip_m[0] - state.origin_m[hand])
        };
        let off_m = grip_m(&state) - grip_m(&ideal);
        assert!((off_m - Vector3::from(habits.grip_off_m[0])).norm() < 1e-9, "{off_m:?}");
    }
}
