//! Predicted overload of a part handed over at a place, against the overload when the person then holds it there.
//!
//! The simulated people reach by their own habits (`equipoise_simulator::reach`), which are no input of the planner; the
//! planner has the bones of the suit, the identified mass distribution and the feet.

use equipoise_core::body::JOINTS;
use equipoise_core::frame::{Pose, StationWorld};
use equipoise_core::handover::experience::{Experience, LimitRatio};
use equipoise_core::handover::search::{Region, SPACING_M, places};
use equipoise_core::handover::{self, Body, Part};
use equipoise_core::overload::TorqueLimits;
use equipoise_simulator::balance::Standing;
use equipoise_simulator::cobot::trial::{PART_KG, WIDTH_M};
use equipoise_simulator::motion::BodyState;
use equipoise_simulator::person::Person;
use equipoise_simulator::random::Random;
use equipoise_simulator::reach::{HeldPart, ReachHabits, at_rest, reach};
use equipoise_simulator::stance::Stance;
use equipoise_simulator::truth::hold::TrueHold;
use equipoise_simulator::truth::static_overload_nm;
use nalgebra::Vector3;

use crate::session::Session;
use crate::subject::{Crowd, Subject, ask_all};
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
    /// Distance of the predicted best place from the true one, m, and the true limit ratio at both.
    best_off_m: f64,
    ratio_at_predicted: f64,
    ratio_at_best: f64,
    /// True limit ratio at the middle of the region.
    ratio_at_middle: f64,
}

/// A subject who is identified, and holds parts.
struct Holder {
    body: Body,
    feet: handover::FootPlacement,
    person: Person,
    standing_on: Stance,
    habits: ReachHabits,
    experience: Experience,
}

impl Holder {
    /// After this number of handovers.
    fn of(subject: &Subject, handovers: u32) -> Holder {
        let mut session = Session::new(subject, subject.settings());
        session.identify_by_windows(POSES_MAX);
        let person = subject.person();
        let standing_on = Stance::shoulder_wide(&person);
        let mut holder = Holder {
            body: session.memory().identification.handover_body(session.settings(), [0.0; JOINTS]),
            feet: handover::FootPlacement {
                ankle_m: standing_on.ankle_m,
                world_from_foot: standing_on.world_from_foot,
            },
            person,
            standing_on,
            habits: ReachHabits::of(subject.seed),
            experience: Experience::default(),
        };
        holder.hand_over(handovers);
        holder
    }

    /// Hands parts over, each at the place that the planner then finds most promising, and learns from each. Places that
    /// the person does not reach are left out.
    fn hand_over(&mut self, handovers: u32) {
        let places: Vec<_> = grid()
            .filter_map(|at_m| {
                Some((at_m, self.modelled(at_m, PART_KG)?, self.true_limit_ratio(at_m, PART_KG)?))
            })
            .collect();
        for _ in 0..handovers {
            let lowest = |(at_m, model, _): &(Vector3<f64>, handover::Prediction, f64)| {
                let corrected = self.experience.correct(*at_m, model.worst_with_sigma());
                corrected.value - corrected.sigma
            };
            let promising = places.iter().min_by(|a, b| lowest(a).total_cmp(&lowest(b)));
            let Some((at_m, model, truth)) = promising else { return };
            let measured = LimitRatio { value: *truth, sigma: 0.0 };
            self.experience.observe(*at_m, model.worst_limit_ratio(), measured);
        }
    }

    /// The worst joint's limit ratio, by the posture model alone.
    fn modelled(&self, at_m: Vector3<f64>, mass_kg: f64) -> Option<handover::Prediction> {
        let part = Part { mass_kg, mass_sigma_kg: 0.0, width_m: WIDTH_M, slope_rad: None };
        handover::predict(&self.body, &self.feet, &part, at_m).ok()
    }

    /// The same with the experience of earlier handovers.
    fn predicted(&self, at_m: Vector3<f64>, mass_kg: f64) -> Option<LimitRatio> {
        let model = self.modelled(at_m, mass_kg)?;
        Some(self.experience.correct(at_m, model.worst_with_sigma()))
    }

    /// The person who holds a part at this place.
    fn holds(&self, at_m: Vector3<f64>, mass_kg: f64) -> Option<BodyState> {
        let standing = Standing {
            person: &self.person,
            com_m: &self.person.com_m,
            stance: &self.standing_on,
            load_kg: mass_kg,
        };
        let held = HeldPart { middle_m: at_m, width_m: WIDTH_M, aside: Vector3::y(), slope_rad: None };
        let (_, balanced) = reach(&standing, &self.habits, &held)?;
        Some(at_rest(&standing, &balanced))
    }

    /// Largest limit ratio of a joint while the person holds the part at this place.
    fn true_limit_ratio(&self, at_m: Vector3<f64>, mass_kg: f64) -> Option<f64> {
        let state = self.holds(at_m, mass_kg)?;
        Some(true_worst_limit_ratio(&self.body.limits, &self.person, &state))
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

/// One subject's results; `None` if no place of the grid is feasible.
pub fn findings(subject: &Subject, handovers: u32) -> Option<Findings> {
    let holder = Holder::of(subject, handovers);
    let mut random = Random::new(subject.seed, "places");
    let (mut held, mut refused, mut missed) = (Vec::new(), 0, 0);
    for _ in 0..PLACES {
        let (at_m, mass_kg) = somewhere(&mut random);
        match (holder.predicted(at_m, mass_kg), holder.true_limit_ratio(at_m, mass_kg)) {
            (Some(predicted), Some(truth)) => {
                held.push(Held { predicted: predicted.value, sigma: predicted.sigma, truth });
            }
            (None, Some(_)) => refused += 1,
            (Some(_), None) => missed += 1,
            (None, None) => {}
        }
    }
    let grid: Vec<Vector3<f64>> = grid().collect();
    let both = grid.iter().filter_map(|at_m| {
        Some((*at_m, holder.predicted(*at_m, PART_KG)?.value, holder.true_limit_ratio(*at_m, PART_KG)?))
    });
    let both: Vec<_> = both.collect();
    let predicted = both.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let best = both.iter().min_by(|a, b| a.2.total_cmp(&b.2))?;
    let middle_m = Vector3::from(PLACE_M.map(|[low, high]| 0.5 * (low + high)));
    Some(Findings {
        held,
        refused,
        missed,
        best_off_m: (predicted.0 - best.0).norm(),
        ratio_at_predicted: predicted.2,
        ratio_at_best: best.2,
        ratio_at_middle: holder.true_limit_ratio(middle_m, PART_KG)?,
    })
}

/// A random place and mass.
fn somewhere(random: &mut Random) -> (Vector3<f64>, f64) {
    let at_m = Vector3::from(PLACE_M.map(|[low, high]| random.between(low, high)));
    (at_m, random.between(MASS_KG[0], MASS_KG[1]))
}

/// The places in the person's middle plane.
pub(crate) fn grid() -> impl Iterator<Item = Vector3<f64>> {
    let [forward, _, up] = PLACE_M;
    places([forward, [0.0, 0.0], up])
}

/// The tables.
pub fn study(crowd: &Crowd) -> Vec<Table> {
    let subjects = crowd.subjects();
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
    table.note(
        "refused: places that the person reaches and the planner calls infeasible; missed: the reverse",
    );
    let mut best = Table::new(
        format!("Best place for {PART_KG} kg on a grid of {SPACING_M} m"),
        &["handovers", "good %", "off m", "ratio there", "ratio at the best", "ratio in the middle"],
    );
    best.note(
        "good: within 5 cm of the true best place, or within 5 % of its overload; medians of true limit ratios",
    );
    for handovers in HANDOVERS {
        let all: Vec<Findings> =
            ask_all(&subjects, |subject| findings(subject, handovers)).into_iter().flatten().collect();
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
    let is_good = |findings: &&Findings| {
        findings.best_off_m <= CLOSE_M
            || findings.ratio_at_predicted <= (1.0 + CLOSE_FRACTION) * findings.ratio_at_best
    };
    let median = |of: &dyn Fn(&Findings) -> f64| {
        Cell::from(quartiles(all.iter().map(of).collect()).map(|[_, median, _]| median))
    };
    let good = all.iter().filter(is_good).count() as f64 / all.len() as f64;
    vec![
        Cell::Count(handovers.into()),
        Cell::Number(100.0 * good),
        median(&|findings| findings.best_off_m),
        median(&|findings| findings.ratio_at_predicted),
        median(&|findings| findings.ratio_at_best),
        median(&|findings| findings.ratio_at_middle),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn predictions_are_as_sure_as_they_say_and_three_handovers_find_a_good_place() {
        let subjects: Vec<Subject> = (700..708).map(Subject::somebody).collect();
        let all: Vec<Findings> =
            ask_all(&subjects, |subject| findings(subject, 3)).into_iter().flatten().collect();
        let held: Vec<&Held> = all.iter().flat_map(|findings| &findings.held).collect();
        let within =
            held.iter().filter(|held| (held.predicted - held.truth).abs() < 2.0 * held.sigma).count();
        assert!(within as f64 > 0.85 * held.len() as f64, "{within} of {}", held.len());
        let relieved =
            all.iter().filter(|found| found.ratio_at_predicted < 0.8 * found.ratio_at_middle).count();
        assert!(relieved >= 7 && all.len() == 8, "{relieved} of {}: {all:?}", all.len());
    }
}
