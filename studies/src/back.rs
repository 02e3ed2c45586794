//! The low back in natural bends, squats and lifts: published moment and axial force against inverse dynamics, and the
//! load moment of each lift's dose against weight times distance.

use equipoise_core::body::Segment;
use equipoise_core::exposure::back::EXTENSOR_LEVER_M;
use equipoise_core::message::Validity;
use equipoise_simulator::GRAVITY_M_PER_S2;
use equipoise_simulator::intention::{Arm, Intention};
use equipoise_simulator::random::Random;
use equipoise_simulator::repertoire::BOX_LOW;
use equipoise_simulator::truth::back::BackLoad;
use nalgebra::Vector3;

use crate::session::{Session, Snapshot};
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::Table;
use crate::tally::{Coverage, Sums, percent};

/// The box, kg.
const BOX_KG: f64 = 11.0;
/// From this fraction of its mass on the hands a box counts as lifted.
const LIFTED: f64 = 0.999;
/// Poses for the identification before.
const POSES_MAX: u32 = 30;
/// Duration from one pose to the next, s.
const PACE_S: f64 = 1.0;
/// Standard deviation per axis between the true L5/S1 and the joint of the suit's skeleton, m: measured segments are
/// off by 3 to 19 mm with posture.
const JOINT_OFF_M: f64 = 0.010;

/// The tasks, as named in the table.
const TASKS: [&str; 3] = ["unloaded, static pose", "unloaded, in motion", "11 kg, in motion"];
/// Whether the true L5/S1 coincides with that of the suit's skeleton.
const JOINTS: [&str; 2] = ["as measured", "10 mm off"];

/// Errors in one task.
#[derive(Debug, Clone, Copy, Default)]
pub struct BackErrors {
    samples: u64,
    error_nm: Sums,
    true_nm: Sums,
    sigma_nm: Sums,
    coverage: Coverage,
    axial_error_n: Sums,
    axial_true_n: Sums,
}

impl BackErrors {
    fn add(&mut self, snapshot: &Snapshot, offset_m: Vector3<f64>) {
        self.samples += 1;
        let state = snapshot.state;
        if state.validity().any_of(Validity::INVALIDATES_LOW_BACK) {
            return;
        }
        let truth = BackLoad::of(snapshot.worker, snapshot.time_s, offset_m);
        let true_nm = truth.moment_nm.xy().norm();
        let error_nm = state.l5s1_moment_nm - true_nm;
        self.error_nm.add(error_nm);
        self.true_nm.add(true_nm);
        self.sigma_nm.add(state.l5s1_moment_sigma_nm);
        self.coverage.add(error_nm, state.l5s1_moment_sigma_nm);
        let axial_n = state.l5s1_compression_n - state.l5s1_moment_nm / EXTENSOR_LEVER_M;
        self.axial_error_n.add(axial_n - truth.axial_n);
        self.axial_true_n.add(truth.axial_n);
    }

    fn merge(&mut self, other: &BackErrors) {
        self.samples += other.samples;
        self.error_nm.merge(&other.error_nm);
        self.true_nm.merge(&other.true_nm);
        self.sigma_nm.merge(&other.sigma_nm);
        self.coverage.merge(&other.coverage);
        self.axial_error_n.merge(&other.axial_error_n);
        self.axial_true_n.merge(&other.axial_true_n);
    }
}

/// [`BackErrors`] by joint and task.
type ByTask = [[BackErrors; TASKS.len()]; JOINTS.len()];

/// Boxes of the lifts that the dose counts, kg.
const DOSE_BOXES_KG: [f64; 3] = [4.0, 8.0, 11.0];

/// Load moments of lifts, by the box.
#[derive(Debug, Clone, Copy, Default)]
pub struct DoseErrors {
    lifts: u64,
    published_nm: Sums,
    true_nm: Sums,
    error_nm: Sums,
}

impl DoseErrors {
    /// One lift: the damage that it added, and the greatest horizontal distance from the hip joints to the box, m.
    fn add(&mut self, damage: f64, box_kg: f64, distance_m: f64) {
        // Inverse of the tool's own relation: damages are compared as the moments that cause them.
        let published_nm = ((damage * 902_416.0).ln() - 0.32) / 0.038;
        let true_nm = box_kg * GRAVITY_M_PER_S2 * distance_m;
        self.lifts += 1;
        self.published_nm.add(published_nm);
        self.true_nm.add(true_nm);
        self.error_nm.add(published_nm - true_nm);
    }

    fn merge(&mut self, other: &DoseErrors) {
        self.lifts += other.lifts;
        self.published_nm.merge(&other.published_nm);
        self.true_nm.merge(&other.true_nm);
        self.error_nm.merge(&other.error_nm);
    }
}

/// Horizontal distance from the middle of the hip joints to the box, m, as a measuring tape would show it.
fn tape_m(snapshot: &Snapshot) -> f64 {
    let body = snapshot.worker.sample(snapshot.time_s);
    let [left, right] = [Segment::LeftUpperLeg, Segment::RightUpperLeg].map(|leg| body.origin_m[leg.index()]);
    (body.load_m() - 0.5 * (left + right)).xy().norm()
}

/// Results of one subject.
#[derive(Debug, Clone, Copy, Default)]
pub struct Findings {
    by_task: ByTask,
    dose: [DoseErrors; DOSE_BOXES_KG.len()],
}

/// Bends and squats, each with a return to standing.
fn bends_and_squats() -> Vec<Intention> {
    let arm = |elevation_deg| Arm { elevation_deg, ..BOX_LOW };
    let stand = Intention::STAND.at_box(arm(30.0));
    let bend = |pelvis_deg: f64, flex_deg: f64| Intention {
        pelvis_deg: [pelvis_deg, 0.0, 0.0],
        trunk_flex_deg: flex_deg,
        ..stand.at_box(arm(60.0))
    };
    let squat = Intention { pelvis_drop: 0.25, ..bend(30.0, 10.0) };
    let aside = Intention { trunk_side_deg: 20.0, ..bend(10.0, 15.0) };
    let turned = Intention { trunk_twist_deg: 30.0, ..bend(20.0, 20.0) };
    let low = [bend(30.0, 30.0), squat, bend(15.0, 40.0), aside, squat, turned, bend(40.0, 20.0)];
    low.into_iter().flat_map(|low| [low, stand]).collect()
}

/// One subject: identification, then the tasks.
pub fn subject(subject: &Subject) -> Findings {
    let mut session = Session::new(subject, subject.settings());
    session.identify(POSES_MAX);
    session.stand(2.0);
    let mut random = Random::new(subject.seed, "place of L5/S1");
    let off_m = Vector3::from_fn(|_, _| JOINT_OFF_M * random.normal());
    let mut by_task = ByTask::default();
    let mut see = |snapshot: &Snapshot, task: usize| {
        for (by_task, offset_m) in by_task.iter_mut().zip([Vector3::zeros(), off_m]) {
            by_task[task].add(snapshot, offset_m);
        }
    };
    let script = bends_and_squats();
    let seconds = script.len() as f64 * PACE_S;
    let perform = |session: &mut Session, box_kg: Option<f64>| {
        session.order(|worker, at_s| {
            for (index, intention) in script.iter().enumerate() {
                worker.intend(intention, at_s + index as f64 * PACE_S, PACE_S);
            }
            if let Some(box_kg) = box_kg {
                worker.lift(box_kg, at_s + PACE_S);
                worker.put_down(at_s + seconds - PACE_S);
            }
        });
    };
    perform(&mut session, None);
    session.run(seconds, |snapshot| see(snapshot, usize::from(snapshot.state.static_pose == 0)));
    session.hold_unknown(6, |snapshot| see(snapshot, 0));
    session.stand(2.0);
    perform(&mut session, Some(BOX_KG));
    session.run(seconds, |snapshot| {
        if snapshot.worker.sample(snapshot.time_s).load_kg >= LIFTED * BOX_KG {
            see(snapshot, 2);
        }
    });
    let mut dose = [DoseErrors::default(); DOSE_BOXES_KG.len()];
    for (box_kg, errors) in DOSE_BOXES_KG.into_iter().zip(&mut dose) {
        session.stand(2.0);
        let (lifts, damage) = (session.state().lifts, session.state().dose_damage);
        let mut greatest_m = 0.0_f64;
        session.lift_at_work(box_kg, |snapshot| {
            if snapshot.worker.sample(snapshot.time_s).load_kg >= LIFTED * box_kg {
                greatest_m = greatest_m.max(tape_m(snapshot));
            }
        });
        session.stand(2.0);
        if session.state().lifts == lifts + 1 {
            errors.add(session.state().dose_damage - damage, box_kg, greatest_m);
        }
    }
    Findings { by_task, dose }
}

/// The table.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let count = cohort.count;
    let cohort = cohort.subjects();
    let mut sums = Findings::default();
    for findings in map_in_parallel(&cohort, subject) {
        for (sum, task) in sums.by_task.iter_mut().flatten().zip(findings.by_task.iter().flatten()) {
            sum.merge(task);
        }
        for (sum, dose) in sums.dose.iter_mut().zip(&findings.dose) {
            sum.merge(dose);
        }
    }
    let mut table = Table::new(
        format!("Moment at L5/S1 and axial force ({count} subjects): published against inverse dynamics"),
        &[
            "task",
            "true joint",
            "samples",
            "published %",
            "moment error RMS N m",
            "bias N m",
            "true RMS N m",
            "sigma N m",
            "1-sigma %",
            "2-sigma %",
            "error/sigma",
            "axial error RMS N",
            "axial bias N",
            "axial true RMS N",
        ],
    );
    for (joint, by_task) in JOINTS.iter().zip(&sums.by_task) {
        for (task, errors) in TASKS.iter().zip(by_task) {
            let mut row = vec![(*task).into(), (*joint).into(), errors.samples.into()];
            row.push(percent(errors.error_nm.count, errors.samples).into());
            row.extend([errors.error_nm.rms(), errors.error_nm.mean()].map(Into::into));
            row.extend([errors.true_nm.rms(), errors.sigma_nm.mean()].map(Into::into));
            row.extend(errors.coverage.percent().map(Into::into));
            row.push(errors.coverage.ratio_rms().into());
            row.extend([errors.axial_error_n.rms(), errors.axial_error_n.mean()].map(Into::into));
            row.push(errors.axial_true_n.rms().into());
            table.push(row);
        }
    }
    table.note("natural pace: bends, squats, side bends and turns 1 s apart, each with a return to standing, no static pose; static pose: also six static poses");
    table.note("true: rates of momentum and angular momentum of everything above L5/S1 with the simulated person's masses and inertias, and the box; magnitude about the horizontal axes, as published");
    table.note("true joint 10 mm off: the simulated person's L5/S1 differs from the measured one by 10 mm (standard deviation per axis, constant per subject)");
    table.note("axial force: published compression minus published moment over the extensor's lever arm; the compression is a one-muscle model without a true value here");
    vec![table, dose_table(&sums.dose, count)]
}

/// The table of the lifts.
fn dose_table(dose: &[DoseErrors], count: usize) -> Table {
    let mut table = Table::new(
        format!(
            "Load moment of a lift in the dose ({count} subjects): published against weight times distance"
        ),
        &["box kg", "lifts counted once", "published N m", "true N m", "bias N m", "error RMS N m"],
    );
    for (box_kg, errors) in DOSE_BOXES_KG.iter().zip(dose) {
        let mut row = vec![(*box_kg).into(), errors.lifts.into()];
        row.extend([errors.published_nm.mean(), errors.true_nm.mean()].map(Into::into));
        row.extend([errors.error_nm.mean(), errors.error_nm.rms()].map(Into::into));
        table.push(row);
    }
    table.note(
        "one lift per subject and box at natural pace, from a table, round to both sides, up, and back",
    );
    table.note("published: moment that corresponds to the accumulated damage; true: weight of the box times its greatest horizontal distance from the middle of the hip joints while it is in the hands");
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hands_are_at_the_box_in_every_posture() {
        assert!(bends_and_squats().iter().all(|intention| intention.at_box));
    }

    #[test]
    fn one_subject_bends_squats_and_lifts() {
        let Findings { by_task: [as_measured, off], dose } = subject(&Subject::random(1));
        for (task, name) in as_measured.iter().zip(TASKS) {
            assert!(task.error_nm.count > 50, "{name}: {task:?}");
            assert!(task.error_nm.rms() < task.true_nm.rms(), "{name}: {task:?}");
        }
        // With the weight alone the error in motion would be three times this.
        assert!(as_measured[1].true_nm.rms() > Some(30.0) && as_measured[1].error_nm.rms() < Some(5.0));
        assert_ne!(as_measured[1].error_nm, off[1].error_nm);
        for errors in &dose {
            let (error_nm, true_nm) = (errors.error_nm.rms().unwrap(), errors.true_nm.rms().unwrap());
            assert!(errors.lifts == 1 && error_nm < 0.12 * true_nm, "{error_nm} of {true_nm} N m");
        }
    }
}
