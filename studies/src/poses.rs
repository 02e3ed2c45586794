//! Number of poses until the model is accurate, by prior and by pose choice.

use equipoise_core::cycle::Identification;
use equipoise_core::cycle::{PoseChoice, Settings, StopRule};
use equipoise_core::frame::{Pose, StationWorld, rotation};
use equipoise_core::static_pose::Window;
use nalgebra::Vector2;

use crate::session::Session;
use crate::subject::{Cohort, Subject, map_in_parallel};
use crate::table::{Cell, Table};
use crate::tally::quartiles;
use crate::tasks::POSE_S;
use crate::variants::{POSE_CHOICES, PriorVariant, divided_library};

/// Maximum number of poses.
const POSES_MAX: u32 = 30;
/// Accurate means that the held-out error is below this, m.
const ACCURATE_M: f64 = 0.010;
/// Numbers of poses at which the error is shown.
const SHOWN: [usize; 5] = [0, 5, 10, 20, 30];

/// Results of one subject's run.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// Held-out error after 0, 1, 2, … poses, m.
    pub error_m: Vec<f64>,
}

impl Course {
    /// Number of poses after which the error stays below a bound; `None` if it never does or is unknown.
    pub fn poses_to(&self, bound_m: f64) -> Option<usize> {
        let above = self.error_m.iter().rposition(|error_m| error_m.is_nan() || *error_m >= bound_m);
        match above {
            None => Some(0),
            Some(last) if last + 1 < self.error_m.len() => Some(last + 1),
            Some(_) => None,
        }
    }

    /// The error after this number of poses, or after the last one, m.
    pub fn after(&self, poses: usize) -> Option<f64> {
        self.error_m.get(poses).or(self.error_m.last()).copied()
    }
}

/// Identifies with up to 30 poses and then checks every intermediate model in the held-out poses.
pub fn course(subject: &Subject, prior: PriorVariant, choice: PoseChoice) -> Course {
    let (learnt, held_out) = divided_library();
    let mut settings = Settings {
        library: learnt,
        pose_choice: choice,
        stop: StopRule::PredictedCop { sigma_m: 0.0 },
        ..subject.settings()
    };
    prior.put_into(&mut settings);
    let mut session = Session::new(subject, settings);
    session.run_until(2.0, |snapshot| snapshot.state.suggested_pose != u32::MAX);
    let model = |session: &Session| Box::new(session.memory().identification);
    let mut models = vec![model(&session)];
    session.identify_in_steps(POSES_MAX, true, |session| models.push(model(session)));
    let mut squares_m2 = vec![0.0; models.len()];
    let mut poses = 0;
    for posture in held_out {
        session.hold(|worker, at_s| worker.take_pose(posture, at_s, POSE_S), |_| {});
        let window = session.memory().window;
        let Some(statistics) =
            window.statistics().filter(|found| found.is_static(&session.settings().static_pose))
        else {
            continue;
        };
        poses += 1;
        for (square_m2, model) in squares_m2.iter_mut().zip(&models) {
            *square_m2 += (published_in(&window, model) - Vector2::from(statistics.cop_m)).norm_squared();
        }
    }
    Course { error_m: squares_m2.iter().map(|square_m2| (square_m2 / f64::from(poses)).sqrt()).collect() }
}

/// Mean centre of pressure of a static window by a model, m.
fn published_in(window: &Window, model: &Identification) -> Vector2<f64> {
    let sum: Vector2<f64> = window
        .samples()
        .map(|held| {
            let pose: Pose<StationWorld> =
                Pose::new(held.origin_m.map(Into::into), held.orientation_wxyz.map(rotation));
            Vector2::from(model.predict_cop_m(&model.reduction.rows(&pose, [0.0; 2])))
        })
        .sum();
    sum / window.samples().count() as f64
}

/// The table.
pub fn study(cohort: &Cohort) -> Vec<Table> {
    let count = cohort.count;
    let cohort = cohort.subjects();
    let mut questions = Vec::new();
    for (prior_name, prior) in PriorVariant::ALL {
        for (choice_name, choice) in POSE_CHOICES {
            questions
                .extend(cohort.iter().map(|subject| (*subject, (prior_name, prior), (choice_name, choice))));
        }
    }
    let courses =
        map_in_parallel(&questions, |(subject, (_, prior), (_, choice))| course(subject, *prior, *choice));
    let mut table = Table::new(
        format!("Poses until the CoP error is below 10 mm ({count} subjects each)"),
        &[
            "prior",
            "choice",
            "lower quartile",
            "median",
            "upper quartile",
            "not reached",
            "error mm after 0",
            "after 5",
            "after 10",
            "after 20",
            "after 30",
        ],
    );
    for (question, courses) in questions.chunks(count).zip(courses.chunks(count)) {
        let (_, (prior, _), (choice, _)) = question[0];
        // Subjects that do not reach it count as one pose more than the maximum.
        let never = courses.iter().filter(|course| course.poses_to(ACCURATE_M).is_none()).count() as u64;
        let poses = courses
            .iter()
            .map(|course| course.poses_to(ACCURATE_M).map_or(f64::from(POSES_MAX + 1), |poses| poses as f64));
        let mut row = vec![prior.into(), choice.into()];
        row.extend(quartiles(poses.collect()).unwrap_or_default().map(|poses| Cell::Count(poses as u64)));
        row.push(never.into());
        row.extend(SHOWN.map(|after| {
            let errors = courses.iter().filter_map(|course| course.after(after)).collect();
            Cell::from(quartiles(errors).map(|[_, median, _]| 1e3 * median))
        }));
        table.push(row);
    }
    let (learnt, held_out) = divided_library();
    table.note(format!(
        "poses: smallest number after which the held-out error stays below 10 mm up to {POSES_MAX} poses; {} if not reached",
        POSES_MAX + 1
    ));
    table.note(format!(
        "held-out error: RMS distance of the estimated from the measured centre of pressure, means over a static window, over {} poses of the library; the other {} are available for identification",
        held_out.len(),
        learnt.len()
    ));
    table.note("error mm after n poses: median over the subjects");
    table.note(
        "wrong: prior with a sigma of 3 mm of a body with a trunk 25 % lighter, legs 25 % heavier, trunk's centres 4 cm further back",
    );
    vec![table]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accurate_for_good_is_after_the_last_time_it_was_not() {
        let to_10_mm = |error_m: &[f64]| Course { error_m: error_m.to_vec() }.poses_to(0.010);
        assert_eq!(to_10_mm(&[0.020, 0.005, 0.011, 0.009]), Some(3));
        assert_eq!(to_10_mm(&[0.009, 0.005]), Some(0));
        assert_eq!(to_10_mm(&[0.009, 0.015]), None);
        // No held-out pose was static.
        assert_eq!(to_10_mm(&[f64::NAN; 3]), None);
    }

    #[test]
    fn a_pose_teaches_one_who_believes_nothing() {
        let course = course(&Subject::random(4), PriorVariant::None, PoseChoice::Paper);
        assert!(course.error_m.len() > 20, "{}", course.error_m.len());
        let (at_first_m, at_last_m) = (course.error_m[0], course.after(30).unwrap_or(f64::NAN));
        assert!(at_first_m > 0.05 && at_last_m < 0.25 * at_first_m, "{at_first_m} {at_last_m}");
    }
}
