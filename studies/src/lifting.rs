//! Loads lifted at natural speed, and natural motion without a load.

use equipoise_core::cycle::{Motion, Settings};
use equipoise_core::message::{State, Validity};
use equipoise_core::overload::Level;

use crate::sensors::{Ground, Rig};
use crate::session::{Output, Session, Snapshot};
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tally::{ByGroup, GROUPS, percent};
use crate::tasks::{CopErrors, publishes_torques};
use crate::variants::MOTIONS;

/// Boxes that are lifted, kg.
const BOXES_KG: [f64; 3] = [4.0, 8.0, 12.0];
/// Poses for the identification before.
const POSES_MAX: u32 = 30;
/// Steps of marching on the spot.
const STEPS: u32 = 8;
/// From this fraction of its mass on the hands a box counts as lifted.
const LIFTED: f64 = 0.999;
/// Upper limit of the number of invalid reasons.
const REASONS: usize = 32;
const _: () = assert!(Validity::NAMES.len() <= REASONS);

/// How often torques were reported, and the reasons if not.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PublicationTally {
    /// New states, or ticks.
    pub samples: u64,
    /// Those with torques.
    pub published: u64,
    /// Those with torques that put some joint above green.
    pub coloured: u64,
    /// How often each invalid reason was raised, by [`Validity::NAMES`]; one state may have several.
    withheld: [u64; REASONS],
}

impl PublicationTally {
    /// Adds a state.
    pub fn add(&mut self, state: &State) {
        self.add_validity(state.validity(), publishes_torques(state));
        if publishes_torques(state) {
            let above = [Level::Orange, Level::Red, Level::AboveMax].map(|level| level as u32);
            self.coloured += u64::from(state.joint_level.iter().any(|level| above.contains(level)));
        }
    }

    /// Adds the output at a tick, for fractions of the time. Without a current state torques are withheld.
    pub fn add_output(&mut self, output: &Output) {
        let is_valid = !output.validity.any_of(Validity::INVALIDATES_TORQUES);
        self.add_validity(output.validity, is_valid && output.is_current);
    }

    fn add_validity(&mut self, valid: Validity, is_published: bool) {
        self.samples += 1;
        self.published += u64::from(is_published);
        for (count, (reason, _)) in self.withheld.iter_mut().zip(Validity::NAMES) {
            *count += u64::from(valid.any_of(*reason) && !is_published);
        }
    }

    pub(crate) fn merge(&mut self, other: &PublicationTally) {
        self.samples += other.samples;
        self.published += other.published;
        self.coloured += other.coloured;
        for (sum, count) in self.withheld.iter_mut().zip(other.withheld) {
            *sum += count;
        }
    }

    /// The most frequent reasons with their fractions of all samples.
    pub(crate) fn reasons(&self) -> String {
        let mut all: Vec<(u64, &str)> =
            self.withheld.iter().copied().zip(Validity::NAMES.iter().map(|(_, name)| *name)).collect();
        all.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
        let shown = all.iter().take(3).filter(|(count, _)| *count > 0);
        let words: Vec<String> = shown
            .map(|(count, name)| format!("{name} {:.0} %", percent(*count, self.samples).unwrap_or(0.0)))
            .collect();
        if words.is_empty() { "-".into() } else { words.join(", ") }
    }
}

/// Results of one subject.
#[derive(Debug, Clone, Copy, Default)]
pub struct Findings {
    lifting: [(ByGroup, PublicationTally); BOXES_KG.len()],
    work: (CopErrors, PublicationTally),
    march: (CopErrors, PublicationTally),
}

impl Findings {
    fn merge(&mut self, other: &Findings) {
        for ((torques, published), (others, others_published)) in self.lifting.iter_mut().zip(&other.lifting)
        {
            torques.merge(others);
            published.merge(others_published);
        }
        for (sum, task) in [(&mut self.work, &other.work), (&mut self.march, &other.march)] {
            sum.0.merge(&task.0);
            sum.1.merge(&task.1);
        }
    }
}

/// Identification, work without a load, marching, and lifts of every box.
pub fn findings(subject: &Subject, motion: Motion, ground: Ground) -> Findings {
    let settings = Settings { motion, ..subject.settings() };
    let rig = Rig { ground, ..subject.rig() };
    let mut session = Session::with(subject, settings, rig, subject.habits());
    session.identify(POSES_MAX);
    session.stand(2.0);
    let mut findings = Findings::default();
    let see = |snapshot: &Snapshot, (cop, tally): &mut (CopErrors, PublicationTally)| {
        cop.add(snapshot);
        tally.add(snapshot.state);
    };
    session.work_unloaded(|snapshot| see(snapshot, &mut findings.work));
    session.stand(2.0);
    session.march(STEPS, |snapshot| see(snapshot, &mut findings.march));
    for (mass_kg, (torques, tally)) in BOXES_KG.into_iter().zip(&mut findings.lifting) {
        session.stand(2.0);
        session.lift_at_work(mass_kg, |snapshot| see_lifted(snapshot, mass_kg, torques, tally));
    }
    findings
}

/// Adds a state if the hands carry the whole box at its time.
pub(crate) fn see_lifted(
    snapshot: &Snapshot,
    mass_kg: f64,
    torques: &mut ByGroup,
    tally: &mut PublicationTally,
) {
    if snapshot.worker.sample(snapshot.time_s).load_kg < LIFTED * mass_kg {
        return;
    }
    tally.add(snapshot.state);
    if publishes_torques(snapshot.state) {
        let truth = snapshot.truth();
        torques.add(&snapshot.state.torque_nm, &snapshot.state.torque_sigma_nm, &truth.overload_in_motion_nm);
    }
}

/// The tables.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let subjects = cohort.subjects();
    let [(compensated, motion), (paper, paper_motion)] = MOTIONS;
    let sums = [
        (compensated, motion, Ground::Plate),
        ("compensated, two plates", motion, Ground::TwoPlates),
        (paper, paper_motion, Ground::Plate),
    ]
    .map(|(name, motion, ground)| {
        let mut sum = Findings::default();
        for findings in map_in_parallel(&subjects, |subject| findings(subject, motion, ground)) {
            sum.merge(&findings);
        }
        (name, sum)
    });
    vec![torque_table(cohort.count, &sums), publication_table(cohort.count, &sums)]
}

/// Errors of the torques by joint group and box.
fn torque_table(count: usize, motions: &[(&str, Findings)]) -> Table {
    let mut table = Table::new(
        format!(
            "Torques while lifting at natural speed ({count} subjects): RMS error in N m and in % of the true RMS, published 1-sigma in N m"
        ),
        &[
            "motion",
            "joint",
            "4 kg error",
            "4 kg %",
            "4 kg sigma",
            "8 kg error",
            "8 kg %",
            "8 kg sigma",
            "12 kg error",
            "12 kg %",
            "12 kg sigma",
        ],
    );
    for (name, sum) in motions {
        for (group, (joint, _)) in GROUPS.iter().enumerate() {
            let mut row: Vec<Cell> = vec![(*name).into(), (*joint).into()];
            for (by_group, _) in &sum.lifting {
                let sums = &by_group.0[group];
                let percent =
                    sums.error_nm.rms().zip(sums.true_nm.rms()).map(|(error, real)| 100.0 * error / real);
                row.extend([sums.error_nm.rms(), percent, sums.sigma_nm.mean()].map(Cell::from));
            }
            table.push(row);
        }
    }
    table.note("natural speed: poses 1 s apart without pauses; a box is lifted from a table, moved to both sides and up, and put back");
    table.note("error: RMS length of published minus true torque, left and right together, over samples with torques and the whole box in the hands");
    table.note("%: of the RMS of the true overload: inverse dynamics of the motion with the box minus without it, forces under each foot and at each hand");
    table.note("sigma: mean of the published 1-sigma of the magnitude");
    table
}

/// How often torques were published, by task.
fn publication_table(count: usize, motions: &[(&str, Findings)]) -> Table {
    let mut table = Table::new(
        format!("Published in motion ({count} subjects)"),
        &[
            "motion",
            "task",
            "CoP error mm",
            "samples",
            "published %",
            "above green %",
            "withheld for (of all samples)",
        ],
    );
    for (name, sum) in motions {
        let unloaded = [("no load: bends, reaches, squats", &sum.work), ("no load: marching", &sum.march)];
        let unloaded =
            unloaded.map(|(task, (cop, published))| (task, Some(1e3 * cop.distance_rms_m()), published));
        let lifting = ["4 kg", "8 kg", "12 kg"].into_iter().zip(&sum.lifting);
        let lifting = lifting.map(|(task, (_, published))| (task, None, published));
        for (task, cop_mm, published) in unloaded.into_iter().chain(lifting) {
            table.push(vec![
                (*name).into(),
                task.into(),
                cop_mm.into(),
                published.samples.into(),
                percent(published.published, published.samples).into(),
                percent(published.coloured, published.samples).into(),
                published.reasons().as_str().into(),
            ]);
        }
    }
    table.note("CoP error: RMS distance of the estimated from the measured centre of pressure, all samples without a load");
    table.note("published: samples with torques; above green: samples with torques where some joint is orange, red or above its maximum; both of all samples of the task");
    table.note("above green without a load: false positives");
    table
}
