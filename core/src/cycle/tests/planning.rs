//! Suggested poses, their number until identification is complete, and poses that cannot be held.

extern crate std;
use std::boxed::Box;
use std::vec::Vec;

use super::bench::*;
use super::filter_updates::*;
use super::*;
use crate::anchor::STANCE_SIGMA_M;
use crate::pose_suggestion::Posture;
use crate::pose_suggestion::library::LIBRARY;
use crate::pose_suggestion::posture;
use crate::sesc::ReductionKind;

fn settings(kind: ReductionKind, choice: PoseChoice) -> Settings {
    Bench::new(|settings| {
        settings.reduction = kind;
        settings.pose_choice = choice;
        settings.library = LIBRARY;
        settings.poses_min = 1;
        settings.stop = StopRule::PredictedCop { sigma_m: 0.0018 };
    })
    .settings
}

/// Runs the planning until a pose is suggested.
fn suggestion(subject: &mut Identification, settings: &Settings, suit_time_ns: u64) -> usize {
    for _ in 0..=2 * LIBRARY.len() {
        subject.plan_step(suit_time_ns, true, None, settings);
        if subject.suggested != NO_POSE {
            return subject.suggested as usize;
        }
    }
    panic!("no suggestion");
}

/// Result of an identification with the suggested poses.
struct Outcome {
    poses: u64,
    error_m: f64,
    predicted_m: f64,
}

/// A person drawn from the table's full prior holds the suggested poses until the stop rule is met.
fn identify(kind: ReductionKind, choice: PoseChoice, seed: u64) -> Outcome {
    let person = Person::real();
    let (mut normal, settings) = (Normal::seeded(seed), settings(kind, choice));
    let full = subject(&person, &self::settings(ReductionKind::Full, choice));
    let theta = drawn(&full, &mut normal);
    let off_m = [0, 1].map(|_| STANCE_SIGMA_M * normal.next());
    let mut one = subject(&person, &settings);
    while one.poses_used < 40 {
        let suggested = suggestion(&mut one, &settings, 1);
        let pose = posture::pose_of(&LIBRARY[suggested], &person.skeleton, [0.0; 3]);
        let variance_m2 = one.drift_variance_m2(&pose, &settings).map(|suit_m2| suit_m2 + 4e-6);
        let cop_m =
            simulated_cop_m(&full.reduction.rows(&pose, [0.0; 2]), &theta, off_m, variance_m2, &mut normal);
        one.update_from_rows(&one.reduction.rows(&pose, [0.0; 2]), cop_m, variance_m2).unwrap();
        one.finish_pose(&pose, &settings);
        if one.identified == 1 {
            break;
        }
    }
    let mut square = 0.0;
    for posture in LIBRARY {
        let pose = posture::pose_of(posture, &person.skeleton, [0.0; 3]);
        let truth = full.reduction.rows(&pose, [0.0; 2]);
        let predicted = one.predict_cop_m(&one.reduction.rows(&pose, [0.0; 2]));
        for axis in 0..2 {
            let body: f64 = truth.h[axis].iter().zip(&theta).map(|(h, theta)| h * theta).sum();
            let error = predicted[axis] - truth.offset_m[axis] - body - off_m[axis];
            square += error * error / (2 * LIBRARY.len()) as f64;
        }
    }
    Outcome { poses: one.poses_used, error_m: square.sqrt(), predicted_m: one.predicted_cop_sigma_m }
}

/// Over people: mean number of poses until complete, root mean square error of the CoP, mean predicted σ.
fn over_people(kind: ReductionKind, choice: PoseChoice, people: u64) -> Outcome {
    let all: Vec<Outcome> = (0..people).map(|seed| identify(kind, choice, seed)).collect();
    let mean = |of: &dyn Fn(&Outcome) -> f64| all.iter().map(of).sum::<f64>() / people as f64;
    Outcome {
        poses: all.iter().map(|one| one.poses).sum(),
        error_m: mean(&|one| one.error_m * one.error_m).sqrt(),
        predicted_m: mean(&|one| one.predicted_m),
    }
}

#[test]
fn information_gain_selects_better_poses_than_distance() {
    let kind = ReductionKind::Merged;
    let paper = over_people(kind, PoseChoice::Paper, 30);
    for choice in [PoseChoice::DOptimal, PoseChoice::IOptimal] {
        let ours = over_people(kind, choice, 30);
        assert!(ours.poses < paper.poses, "{choice:?}: {} {}", ours.poses, paper.poses);
    }
}

#[test]
fn more_parameters_need_no_more_poses_and_keep_sigma_valid() {
    let [hard, merged, full] = [ReductionKind::Symmetric, ReductionKind::Merged, ReductionKind::Full]
        .map(|kind| over_people(kind, PoseChoice::DOptimal, 60));
    for one in [&hard, &merged, &full] {
        assert!(one.error_m < 1.1 * one.predicted_m, "{} {}", one.error_m, one.predicted_m);
        assert!(one.poses * 20 < hard.poses * 21);
    }
}

#[test]
fn a_suggestion_evaluates_one_pose_per_cycle() {
    let (person, settings) = (Person::real(), settings(ReductionKind::Merged, PoseChoice::IOptimal));
    let mut one = subject(&person, &settings);
    let mut cycles = 0;
    while one.suggested == NO_POSE {
        one.plan_step(1, true, None, &settings);
        cycles += 1;
    }
    // Each pose of the library is evaluated once for W and once as a candidate, and one cycle chooses.
    assert_eq!(cycles, 2 * LIBRARY.len() + 1);
    assert_eq!(one.suggested, 0, "the library's first pose is the one to start from");
    // W matches the rows.
    let mut square_m2 = 0.0;
    for posture in LIBRARY {
        let pose = posture::pose_of(posture, &person.skeleton, [0.0; 3]);
        square_m2 += one.cop_variance_m2(&one.reduction.rows(&pose, [0.0; 2])).iter().sum::<f64>();
    }
    let by_rows_m = (square_m2 / (2 * LIBRARY.len()) as f64).sqrt();
    assert!((one.predicted_cop_sigma_m - by_rows_m).abs() < 1e-9 * by_rows_m);
}

#[test]
fn a_pose_that_was_not_held_for_twenty_seconds_is_replaced() {
    let (person, settings) = (Person::real(), settings(ReductionKind::Merged, PoseChoice::IOptimal));
    let mut one = subject(&person, &settings);
    let suggested = suggestion(&mut one, &settings, NS_PER_S);
    one.plan_step(20 * NS_PER_S, true, None, &settings);
    assert_eq!(one.suggested, suggested as u64);
    // Without a person on the plate the time restarts.
    one.plan_step(25 * NS_PER_S, false, None, &settings);
    one.plan_step(44 * NS_PER_S, true, None, &settings);
    assert_eq!(one.suggested, suggested as u64);
    one.plan_step(46 * NS_PER_S, true, None, &settings);
    assert_eq!(one.suggested, NO_POSE);
    for _ in 0..LIBRARY.len() - 1 {
        let other = suggestion(&mut one, &settings, 46 * NS_PER_S);
        assert_ne!(other, suggested);
        one.withdraw_suggestion();
    }
    assert_ne!(
        suggestion(&mut one, &settings, 46 * NS_PER_S),
        suggested,
        "nor after all others were suggested"
    );
}

#[test]
fn a_pose_is_skipped_on_command_and_none_is_suggested_after_identification() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.hold(&person, &postures()[0], None, 500);
    let suggested = bench.state().suggested_pose;
    assert_ne!(suggested, u32::MAX);
    bench.command(CommandKind::PoseSkip);
    assert_eq!(bench.state().suggested_pose, u32::MAX);
    bench.hold(&person, &postures()[0], None, 50);
    let other = bench.state().suggested_pose;
    assert!(other != suggested && other != u32::MAX);
    bench.command(CommandKind::IdentifyStop);
    bench.hold(&person, &postures()[0], None, 50);
    assert_eq!(bench.state().suggested_pose, u32::MAX);
    bench.command(CommandKind::PoseSkip);
    bench.command(CommandKind::IdentifyStart);
    bench.hold(&person, &postures()[0], None, 50);
    assert!(![u32::MAX, suggested].contains(&bench.state().suggested_pose), "a skipped pose stays skipped");
}

#[test]
fn every_suggested_pose_is_in_balance() {
    let library: &'static [Posture] = Box::leak(Box::new([
        stand(0, 0, [-80, 0, 0], [80, 0, 0], 0),
        stand(90, 0, [80, 0, 0], [-80, 0, 0], 0),
        stand(20, 0, [0, 0, -80], [0, 0, 80], 0),
        stand(10, 0, [-80, 0, 0], [0, 0, 80], 0),
    ]));
    let (person, settings) = (Person::real(), Bench::new(|settings| settings.library = library).settings);
    let mut one = subject(&person, &settings);
    let suggested: [usize; 4] = core::array::from_fn(|_| {
        let suggested = suggestion(&mut one, &settings, 1);
        one.withdraw_suggestion();
        suggested
    });
    assert_eq!(
        suggested[3], 1,
        "straight legs under a trunk that lies flat, arms stretched out: {suggested:?}"
    );
}
