//! Coverage of the reported σ: the fraction of errors within their multiples.

use nalgebra::Vector3;

use crate::session::{Session, Snapshot};
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::Table;
use crate::tally::{Coverage, GROUPS, PlanarCoverage, joints_of};
use crate::tasks::{publishes_cop, publishes_torques};
use equipoise_core::message::Validity;

/// Boxes that are lifted, kg.
const BOXES_KG: [f64; 2] = [4.0, 10.0];
/// Poses for the identification before.
const POSES_MAX: u32 = 30;
/// Poses that check the centre of pressure.
const CHECK_POSES: usize = 15;
/// From this fraction of its mass on the hands a box counts as lifted.
const LIFTED: f64 = 0.999;

/// Coverage in one condition.
#[derive(Debug, Clone, Copy, Default)]
pub struct Deviations {
    cop: [Coverage; 2],
    delta_f: Coverage,
    joints: [Coverage; GROUPS.len()],
    /// Of the horizontal components of the joints' torques.
    planar: [PlanarCoverage; GROUPS.len()],
}

impl Deviations {
    fn add(&mut self, snapshot: &Snapshot, carries: bool) {
        let (state, truth) = (snapshot.state, snapshot.truth());
        if publishes_cop(state) {
            for axis in 0..2 {
                let error_m = state.cop_estimated_m[axis] - truth.cop_without_load_in_motion_m[axis];
                self.cop[axis].add(error_m, state.cop_sigma_m[axis]);
            }
        }
        if !state.validity().any_of(Validity::INVALIDATES_DELTA_F) {
            let error_n = state.delta_f_n[2] + truth.load_force_in_motion_n.z;
            self.delta_f.add(error_n, state.delta_f_sigma_n);
        }
        if carries && publishes_torques(state) {
            for (group, coverage) in self.joints.iter_mut().enumerate() {
                for joint in joints_of(group) {
                    let deviations = Vector3::from(state.torque_nm[joint]);
                    let error_nm = magnitude_error_nm(deviations, truth.overload_in_motion_nm[joint]);
                    coverage.add(error_nm, state.torque_sigma_nm[joint]);
                    let off = deviations - truth.overload_in_motion_nm[joint];
                    self.planar[group].add([off.x, off.y], snapshot.state.torque_covariance_nm2[joint]);
                }
            }
        }
    }

    /// The table's rows.
    fn rows(&self) -> Vec<(String, Coverage)> {
        let quantities = ["CoP forward", "CoP sideways", "external force, vertical"].map(String::from);
        let mut rows: Vec<_> =
            quantities.into_iter().zip(self.cop.into_iter().chain([self.delta_f])).collect();
        let groups = GROUPS.iter().map(|(name, _)| name);
        rows.extend(groups.clone().zip(self.joints).map(|(name, coverage)| (name.to_string(), coverage)));
        rows.push(("all joints".into(), Coverage::of_all(&self.joints)));
        for (name, planar) in groups.zip(&self.planar) {
            rows.push((format!("{name}, each horizontal axis"), planar.by_axis));
            rows.push((format!("{name}, both axes together"), planar.by_distance));
        }
        rows
    }
}

/// Error of a published torque's magnitude, N m.
fn magnitude_error_nm(published: Vector3<f64>, real: Vector3<f64>) -> f64 {
    published.norm() - real.norm()
}

/// One subject: static and in motion.
pub fn deviations(subject: &Subject) -> [Deviations; 2] {
    let mut session = Session::new(subject, subject.settings());
    session.identify(POSES_MAX);
    let mut both = [Deviations::default(); 2];
    session.hold_unknown(CHECK_POSES, |snapshot| both[0].add(snapshot, false));
    session.stand(2.0);
    let sort = |snapshot: &Snapshot, both: &mut [Deviations; 2], mass_kg: f64| {
        let carries = snapshot.worker.sample(snapshot.time_s).load_kg >= LIFTED * mass_kg;
        let condition = usize::from(snapshot.state.static_pose == 0);
        both[condition].add(snapshot, carries);
    };
    session.work_unloaded(|snapshot| sort(snapshot, &mut both, f64::INFINITY));
    for mass_kg in BOXES_KG {
        session.stand(2.0);
        session.lift(mass_kg, |snapshot| sort(snapshot, &mut both, mass_kg));
        session.lift_at_work(mass_kg, |snapshot| sort(snapshot, &mut both, mass_kg));
    }
    both
}

/// The table.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let people = map_in_parallel(&cohort.subjects(), |subject| {
        deviations(subject).map(|deviations| deviations.rows())
    });
    let mut table = Table::new(
        format!("Coverage of errors by the published sigma ({} subjects, default method)", cohort.count),
        &[
            "quantity",
            "static: 1-sigma %",
            "static: standard error",
            "static: 2-sigma %",
            "static: error/sigma",
            "motion: 1-sigma %",
            "motion: standard error",
            "motion: 2-sigma %",
            "motion: error/sigma",
        ],
    );
    for (row, (name, _)) in people[0][0].iter().enumerate() {
        let mut cells = vec![name.as_str().into()];
        for condition in 0..2 {
            let coverage: Vec<Coverage> =
                people.iter().map(|deviations| deviations[condition][row].1).collect();
            let all = Coverage::of_all(&coverage);
            let [once, twice] = all.percent();
            let cell = [once, Coverage::standard_error_percent(&coverage), twice, all.ratio_rms()];
            cells.extend(cell.map(Into::into));
        }
        table.push(cells);
    }
    table.note("a normal error lies within 1 sigma 68.3 % and within 2 sigma 95.4 % of the time; error/sigma: root mean square, 1 where sigma is right");
    table.note("standard error of the 1-sigma percentage, from its spread between the subjects: errors of one subject are correlated");
    table.note("CoP: estimated minus true centre of pressure of the unloaded body in this motion; force: vertical, published minus true");
    table.note("joints: magnitude of the published torque minus that of the true torque, with the whole box of 4 or 10 kg in the hands; true: inverse dynamics, forces under each foot and at each hand");
    table.note("each horizontal axis: error over its own 1-sigma; both axes together: Mahalanobis distance by the covariance, as the normal deviate of the same probability");
    table.note("static: the estimator's static pose; motion: all other samples");
    vec![table]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_subject_is_seen_still_and_in_motion() {
        let [still, moving] = deviations(&Subject::random(1));
        for coverage in still.cop.iter().chain(&moving.cop).chain(&still.joints) {
            assert!(coverage.count > 100, "{coverage:?}");
            let [once, twice] = coverage.percent().map(Option::unwrap_or_default);
            assert!(once <= twice && twice <= 100.0);
        }
    }
}
