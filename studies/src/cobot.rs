//! The closed loop: a cobot that presents a part where the estimate of the worker's overload says, against a fixed place.
//!
//! The controller has the published states and the identified body. The worker reaches by habits that are no input of the
//! planner (`equipoise_simulator::reach`), and the effect is computed from the simulator's torques.

pub mod course;
pub mod held;
pub mod planner;
pub mod station;

use equipoise_core::body::Joint;
use equipoise_core::handover::experience::LimitRatio;

use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tally::{Sums, quartiles};
use course::{Course, Purpose};
use equipoise_simulator::cobot::trial::{FIXED_M, PART_KG};
use held::HoldResult;
use planner::Presentation;
use station::Station;

/// Results of one subject.
#[derive(Debug, Clone)]
pub struct Findings {
    /// At the fixed place; `None` if the worker does not reach it or no torque was published.
    baseline: Option<HoldResult>,
    /// At the fixed place with the handles of a level box; not measured by a controller.
    level: Option<HoldResult>,
    /// Where the controller learned.
    learning: Vec<HoldResult>,
    /// At the final place; that is the fixed one if no other is better by more than σ.
    assisted: Option<(Presentation, HoldResult)>,
    /// Handovers without a measurement: the arm did not arrive, or the worker did not reach the part.
    unmeasured: u64,
    /// Steps of the arm outside its limits.
    exceeded: u64,
}

impl Findings {
    /// Limit ratios at the fixed and the final place, if both were measured.
    fn both(&self) -> Option<[HoldResult; 2]> {
        Some([self.baseline?, self.assisted?.1])
    }

    /// Change of the true limit ratio, per cent of the baseline's.
    fn change_percent(&self) -> Option<f64> {
        let [before, after] = self.both()?;
        Some(100.0 * (after.truth / before.truth - 1.0))
    }

    /// The same against the fixed place with a level box.
    fn change_from_level_percent(&self) -> Option<f64> {
        Some(100.0 * (self.assisted?.1.truth / self.level?.truth - 1.0))
    }

    /// Whether the true limit ratio rises by more than the published σ.
    fn rises(&self) -> bool {
        self.both().is_some_and(|[before, after]| after.truth - before.truth > after.measured.sigma)
    }
}

/// The handovers of one subject; `None` if the arm cannot start.
pub fn findings(subject: &Subject) -> Option<Findings> {
    let mut station = Station::new(subject).ok()?;
    let mut course = Course::new(station.planner());
    let mut findings = Findings {
        baseline: None,
        level: None,
        learning: Vec::new(),
        assisted: None,
        unmeasured: 0,
        exceeded: 0,
    };
    while let Some((purpose, part)) = course.next() {
        let held = if station.present(part) { station.hold(part.slope_rad.is_none()) } else { None };
        course.end(part, held.map(|held| held.measured));
        match (purpose, held) {
            (_, None) => findings.unmeasured += 1,
            (Purpose::Baseline, held) => findings.baseline = held,
            (Purpose::Level, held) => findings.level = held,
            (Purpose::Learning, Some(held)) => findings.learning.push(held),
            (Purpose::Assisted, Some(held)) => findings.assisted = Some((part, held)),
        }
    }
    findings.exceeded = station.exceeded();
    Some(findings)
}

/// The tables.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let subjects = cohort.subjects();
    let all = map_in_parallel(&subjects, findings);
    let mut workers = Table::new(
        format!("Limit ratio of the worst joint with {PART_KG} kg, fixed place against assisted"),
        &[
            "seed",
            "m",
            "kg",
            "fixed",
            "fixed estimate",
            "level",
            "forward m",
            "left m",
            "up m",
            "slope deg",
            "assisted",
            "assisted estimate",
            "sigma",
            "change %",
        ],
    );
    let [x, y, z] = FIXED_M.into();
    workers.note(format!(
        "fixed: at {x} m forward, {y} m to the left, {z} m up for all, with handles that turn with the hands; level: there, \
         with fixed handles of a level box; forward, left, up, slope: assisted handover"
    ));
    workers.note(
        "fixed, assisted: true static overload, mean of 3 s; estimate and sigma (of the assisted one): published",
    );
    for (subject, findings) in subjects.iter().zip(&all) {
        let Some(findings) = findings else { continue };
        workers.push(row(subject, findings));
    }
    vec![workers, summary(all.iter().flatten()), coverage(all.iter().flatten())]
}

fn row(subject: &Subject, findings: &Findings) -> Vec<Cell> {
    let (fixed, assisted) = (findings.baseline, findings.assisted);
    let at_m = |axis: usize| Cell::from(assisted.map(|(part, _)| part.at_m[axis]));
    let held = assisted.map(|(_, held)| held);
    vec![
        subject.seed.into(),
        subject.height_m.into(),
        subject.mass_kg.into(),
        fixed.map(|held| held.truth).into(),
        fixed.map(|held| held.measured.value).into(),
        findings.level.map(|held| held.truth).into(),
        at_m(0),
        at_m(1),
        at_m(2),
        assisted.and_then(|(part, _)| part.slope_rad).map(f64::to_degrees).into(),
        held.map(|held| held.truth).into(),
        held.map(|held| held.measured.value).into(),
        held.map(|held| held.measured.sigma).into(),
        findings.change_percent().into(),
    ]
}

fn summary<'a>(all: impl Iterator<Item = &'a Findings> + Clone) -> Table {
    let mut table = Table::new(
        "Summary",
        &[
            "subjects",
            "compared",
            "median reduction %",
            "from level %",
            "smallest %",
            "rises by more than sigma",
            "learning handovers",
            "of them above fixed by more than sigma",
            "without a measurement",
            "arm steps outside limits",
        ],
    );
    let compared: Vec<f64> = all.clone().filter_map(Findings::change_percent).map(|change| -change).collect();
    let from_level: Vec<f64> =
        all.clone().filter_map(Findings::change_from_level_percent).map(|change| -change).collect();
    let above = |findings: &Findings| {
        let Some(fixed) = findings.baseline else { return 0 };
        findings.learning.iter().filter(|held| held.truth - fixed.truth > held.measured.sigma).count()
    };
    table.push(vec![
        (all.clone().count() as u64).into(),
        (compared.len() as u64).into(),
        quartiles(compared.clone()).map(|[_, median, _]| median).into(),
        quartiles(from_level).map(|[_, median, _]| median).into(),
        compared.iter().copied().reduce(f64::min).into(),
        (all.clone().filter(|findings| findings.rises()).count() as u64).into(),
        all.clone().map(|findings| findings.learning.len() as u64).sum::<u64>().into(),
        (all.clone().map(above).sum::<usize>() as u64).into(),
        all.clone().map(|findings| findings.unmeasured).sum::<u64>().into(),
        all.map(|findings| findings.exceeded).sum::<u64>().into(),
    ]);
    table.note("reduction: of the true limit ratio from the fixed to the assisted handover");
    table.note("sigma: published 1-sigma of the later handover");
    table
}

/// All holds of one subject.
impl Findings {
    fn holds(&self) -> impl Iterator<Item = &HoldResult> {
        self.baseline.iter().chain(&self.learning).chain(self.assisted.iter().map(|(_, held)| held))
    }
}

/// Errors of the published limit ratios of one kind, over their limit and over their σ.
#[derive(Debug, Clone, Copy, Default)]
struct Errors {
    published: Sums,
    truth: Sums,
    error: Sums,
    sigma: Sums,
    normalised: Sums,
    within: [u64; 2],
}

impl Errors {
    fn add(&mut self, published: LimitRatio, truth: f64) {
        let error = published.value - truth;
        self.published.add(published.value);
        self.truth.add(truth);
        self.error.add(error);
        self.sigma.add(published.sigma);
        self.normalised.add(error / published.sigma);
        for (within, sigmas) in self.within.iter_mut().zip([1.0, 2.0]) {
            *within += u64::from(error.abs() <= sigmas * published.sigma);
        }
    }

    fn row(&self, name: &'static str) -> Vec<Cell> {
        let percent = |within: u64| 100.0 * within as f64 / self.error.count as f64;
        vec![
            name.into(),
            self.error.count.into(),
            self.truth.mean().into(),
            self.published.mean().into(),
            self.error.mean().into(),
            self.error.rms().into(),
            self.sigma.rms().into(),
            self.normalised.mean().into(),
            percent(self.within[0]).into(),
            percent(self.within[1]).into(),
        ]
    }
}

/// Published against true limit ratios of all holds.
fn coverage<'a>(all: impl Iterator<Item = &'a Findings>) -> Table {
    let mut table = Table::new(
        "Published limit ratios of all holds",
        &[
            "joint",
            "holds",
            "truth",
            "published",
            "bias",
            "RMS error",
            "RMS sigma",
            "bias, sigma",
            "within 1 sigma %",
            "within 2 sigma %",
        ],
    );
    let holds: Vec<&HoldResult> = all.flat_map(Findings::holds).collect();
    let (mut worst, mut selected) = (Errors::default(), Errors::default());
    for hold in &holds {
        worst.add(hold.measured, hold.truth);
        selected.add(hold.joints[hold.joint.index()].0, hold.truth);
    }
    table.push(worst.row("worst"));
    table.push(selected.row("largest estimate"));
    for joint in Joint::ALL {
        let mut errors = Errors::default();
        holds.iter().for_each(|hold| {
            let (published, truth) = hold.joints[joint.index()];
            errors.add(published, truth);
        });
        table.push(errors.row(joint.name()));
    }
    table.note("worst: mean and sigma of the largest ratio of a joint, against the largest true one");
    table.note(
        "largest estimate: the ratio of the joint with the largest estimate, against the largest true one",
    );
    table.note("holds of one subject have common errors: the grip, the body model");
    table
}

#[cfg(test)]
mod tests {
    use equipoise_core::body::JOINTS;

    use super::*;

    #[test]
    fn no_assisted_place_overloads_and_the_arm_keeps_its_limits() {
        let subjects: Vec<Subject> = (720..722).map(Subject::random).collect();
        for (subject, findings) in subjects.iter().zip(map_in_parallel(&subjects, findings)) {
            let findings = findings.unwrap();
            let [before, after] = findings.both().unwrap();
            assert!(!findings.rises(), "{}: {findings:?}", subject.seed);
            for held in [before, after] {
                assert!(
                    (held.measured.value - held.truth).abs() < 3.0 * held.measured.sigma,
                    "{}: {held:?}",
                    subject.seed
                );
            }
            assert_eq!((findings.exceeded, findings.learning.len()), (0, course::LEARNING));
        }
    }

    #[test]
    fn a_rise_counts_only_beyond_sigma() {
        let held = |truth: f64| HoldResult {
            joint: Joint::ALL[0],
            measured: LimitRatio { value: truth, sigma: 0.05 },
            truth,
            joints: [(LimitRatio { value: truth, sigma: 0.05 }, truth); JOINTS],
        };
        let after = |truth: f64| Findings {
            baseline: Some(held(0.5)),
            level: Some(held(0.6)),
            learning: vec![held(0.6), held(0.52)],
            assisted: Some((course::FIXED, held(truth))),
            unmeasured: 0,
            exceeded: 0,
        };
        assert!(after(0.56).rises() && !after(0.54).rises() && !after(0.3).rises());
        assert!((after(0.3).change_percent().unwrap() + 40.0).abs() < 1e-9);
        assert!((after(0.3).change_from_level_percent().unwrap() + 50.0).abs() < 1e-9);
        let row = summary([after(0.56), after(0.3)].iter()).rows()[0].clone();
        assert_eq!(row[5], Cell::Count(1));
        assert_eq!(row[7], Cell::Count(2));
    }
}
