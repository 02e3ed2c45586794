//! The paper's experiment, by the paper's method and by this project's.

use equipoise_core::cycle::Settings;
use equipoise_core::sesc::ReductionKind;

use crate::session::Session;
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tally::{ByGroup, GROUPS, Sums, quartiles};
use crate::tasks::{CopErrors, Identified, publishes_torques};
use crate::variants::paper;

/// The box of the paper, kg.
const BOX_KG: f64 = 4.0;
/// Upper limit of the number of poses.
const POSES_MAX: u32 = 60;
/// Poses that check the model.
const CHECK_POSES: usize = 15;
/// From this fraction of its mass on the hands a box counts as lifted.
const LIFTED: f64 = 0.999;

/// Results of one subject's experiment.
#[derive(Debug, Clone, Copy)]
pub struct Trial {
    identified: Identified,
    cop: CopErrors,
    base_m: f64,
    before: ByGroup,
    lifting: ByGroup,
}

/// Identification, check in held-out poses, lift.
pub fn trial(subject: &Subject, settings: Settings) -> Trial {
    let mut session = Session::new(subject, settings);
    let identified = session.identify(POSES_MAX);
    // The torques of a changed model are withheld for a second.
    session.run(1.2, |_| {});
    let (mut cop, mut before, mut lifting) = (CopErrors::default(), ByGroup::default(), ByGroup::default());
    session.hold_unknown(CHECK_POSES, |snapshot| {
        cop.add(snapshot);
        if publishes_torques(snapshot.state) {
            let truth = snapshot.truth();
            before.add(
                &snapshot.state.torque_nm,
                &snapshot.state.torque_sigma_nm,
                &truth.overload_in_motion_nm,
            );
        }
    });
    session.lift(BOX_KG, |snapshot| {
        if publishes_torques(snapshot.state) {
            let truth = snapshot.truth();
            if truth.body.load_kg >= LIFTED * BOX_KG {
                lifting.add(
                    &snapshot.state.torque_nm,
                    &snapshot.state.torque_sigma_nm,
                    &truth.overload_in_motion_nm,
                );
            }
        }
    });
    let outline = subject.person().foot_outline_m;
    Trial { identified, cop, base_m: outline.back + outline.forward, before, lifting }
}

/// The settings of the tables' rows.
fn variants(subject: &Subject) -> [(&'static str, Settings); 4] {
    [
        ("paper, 69 parameters", paper(subject, ReductionKind::Full)),
        ("paper, merged (42)", paper(subject, ReductionKind::Merged)),
        ("paper, symmetric (16)", paper(subject, ReductionKind::Symmetric)),
        ("default", subject.settings()),
    ]
}

/// The tables.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let subjects = cohort.of_the_paper();
    let mut identification = identification_table(cohort.count);
    let mut torques = torque_table();
    for variant in 0..4 {
        let trials = map_in_parallel(&subjects, |subject| trial(subject, variants(subject)[variant].1));
        let name = variants(&subjects[0])[variant].0;
        identification.push(identification_row(name, &trials));
        add_torques(&mut torques, name, &trials);
    }
    vec![identification, torques]
}

/// Without rows; see [`identification_row`].
fn identification_table(count: usize) -> Table {
    let mut table = Table::new(
        format!("Identification: 1.77 m, 72 kg, {count} bodies"),
        &[
            "method",
            "poses",
            "converged",
            "largest P_jj m2",
            "predicted CoP sigma mm",
            "CoP forward mm",
            "CoP sideways mm",
            "CoP distance mm",
            "% of base",
            "% of range",
        ],
    );
    table.note(
        "poses: median over the bodies of the poses until the stop rule is met (the paper: 25, one person)",
    );
    table.note(format!("converged: bodies for which it is met within {POSES_MAX} poses"));
    table.note(
        "largest P_jj: median at the end; initially 1 m2 without a prior; unobservable directions keep their variance",
    );
    table.note("predicted CoP sigma: median of the filter's predicted 1-sigma over the library, both axes");
    table.note(format!(
        "CoP: RMS over the bodies of estimated minus measured, static, without a load, in {CHECK_POSES} poses outside the library (trunk and arms of different poses)"
    ));
    table.note(
        "% of base: distance over the length of the base of support, heel to toe; % of range: distance over the diagonal of the measured CoP's range (the paper: 16.17 %, denominator not stated)",
    );
    table
}

/// Without rows; see [`add_torques`].
fn torque_table() -> Table {
    let mut table = Table::new(
        format!("Torques before and while lifting {BOX_KG} kg"),
        &[
            "method",
            "joint",
            "before N m",
            "lifting N m",
            "true N m",
            "error RMS N m",
            "1-sigma N m",
            "published",
        ],
    );
    table.note("before, lifting: mean published magnitude; '-': not published, below the load threshold");
    table.note(
        "true: mean magnitude by inverse dynamics of the motion with the box minus without it, forces under each foot at its own pressure point and at each hand",
    );
    table.note("error: RMS length of the difference vector; published: samples of both sides");
    table
}

/// Adds one row per joint group.
fn add_torques(table: &mut Table, name: &str, trials: &[Trial]) {
    let (mut before, mut lifting) = (ByGroup::default(), ByGroup::default());
    for trial in trials {
        before.merge(&trial.before);
        lifting.merge(&trial.lifting);
    }
    for (group, (joint, _)) in GROUPS.iter().enumerate() {
        let (before, lifting) = (&before.0[group], &lifting.0[group]);
        table.push(vec![
            name.into(),
            (*joint).into(),
            before.published_nm.mean().into(),
            lifting.published_nm.mean().into(),
            lifting.true_nm.mean().into(),
            lifting.error_nm.rms().into(),
            lifting.sigma_nm.mean().into(),
            lifting.published_nm.count.into(),
        ]);
    }
}

fn identification_row(name: &str, trials: &[Trial]) -> Vec<Cell> {
    let median = |value: &dyn Fn(&Trial) -> f64| {
        Cell::from(quartiles(trials.iter().map(value).collect()).map(|[_, median, _]| median))
    };
    let pooled = |value: &dyn Fn(&Trial) -> f64| {
        let mut sums = Sums::default();
        trials.iter().for_each(|trial| sums.add(value(trial)));
        Cell::from(sums.rms())
    };
    let range_m = |trial: &Trial| trial.cop.range_m()[0].hypot(trial.cop.range_m()[1]);
    vec![
        name.into(),
        median(&|trial| f64::from(trial.identified.poses)),
        (trials.iter().filter(|trial| trial.identified.converged).count() as u64).into(),
        median(&|trial| trial.identified.variance_max_m2),
        median(&|trial| 1e3 * trial.identified.predicted_cop_sigma_m),
        pooled(&|trial| 1e3 * trial.cop.rms_m()[0]),
        pooled(&|trial| 1e3 * trial.cop.rms_m()[1]),
        pooled(&|trial| 1e3 * trial.cop.distance_rms_m()),
        pooled(&|trial| 100.0 * trial.cop.distance_rms_m() / trial.base_m),
        pooled(&|trial| 100.0 * trial.cop.distance_rms_m() / range_m(trial)),
    ]
}
