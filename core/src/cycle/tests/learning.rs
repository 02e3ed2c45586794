//! What a worker's filter makes of poses: stances, the suit's errors.

extern crate std;
use std::boxed::Box;

use nalgebra::Vector3;

use super::bench::*;
use super::*;
use crate::anchor::STANCE_SIGMA_M;
use crate::frame::{Pose, StationWorld, SuitWorld};
use crate::sesc::centre_of_mass;

/// A worker whose bones are known and who has shown nothing else.
fn worker(person: &Person, settings: &Settings) -> Box<Identification> {
    let mut worker = bytemuck::zeroed_box::<Identification>();
    worker.start(settings);
    let pose = person.pose(&postures()[0]);
    let in_suit_world: Pose<SuitWorld> = Pose::new(pose.origin, pose.world_from_segment);
    for _ in 0..20 {
        worker.learn_skeleton(&in_suit_world, settings);
    }
    assert!(worker.has_body());
    worker
}

/// The pose as the anchor shows it in a stance that it put wrongly by `off_m`.
fn off_by(pose: &Pose<StationWorld>, off_m: [f64; 2]) -> Pose<StationWorld> {
    Pose::new(
        pose.origin.map(|origin| origin + Vector3::new(off_m[0], off_m[1], 0.0)),
        pose.world_from_segment,
    )
}

fn learn(worker: &mut Identification, person: &Person, posture: &Posture, off_m: [f64; 2]) {
    let pose = person.pose(posture);
    let cop_m = centre_of_mass(&pose, &person.phi);
    let rows = worker.reduction.rows(&off_by(&pose, off_m), [0.0; 2]);
    worker.take_in(&rows, [cop_m.x, cop_m.y], [1e-6; 2]).unwrap();
}

/// Mean error over all poses of a stance that is put rightly, m, and what the filter says of it.
fn mean_error_m(worker: &Identification, person: &Person) -> ([f64; 2], [f64; 2]) {
    let (mut error, mut sigma, count) = ([0.0; 2], [0.0; 2], postures().len() as f64);
    for posture in postures() {
        let pose = person.pose(&posture);
        let rows = worker.reduction.rows(&pose, [0.0; 2]);
        let (told, truth) = (worker.predict_cop_m(&rows), centre_of_mass(&pose, &person.phi));
        let variance = worker.cop_variance_m2(&rows);
        for axis in 0..2 {
            error[axis] += (told[axis] - truth[axis]) / count;
            sigma[axis] += variance[axis].sqrt() / count;
        }
    }
    (error, sigma)
}

#[test]
fn a_stance_s_offset_does_not_become_part_of_the_worker() {
    let (person, settings) = (Person::real(), Bench::new(|_| {}).settings);
    let off_m = [0.006, -0.006];
    let mut one = worker(&person, &settings);
    for posture in postures() {
        learn(&mut one, &person, &posture, off_m);
    }
    // In the same stance the offset is known together with the body, far better than for itself.
    let pose = person.pose(&postures()[7]);
    let rows = one.reduction.rows(&off_by(&pose, off_m), [0.0; 2]);
    let truth = centre_of_mass(&pose, &person.phi);
    for axis in 0..2 {
        assert!((one.predict_cop_m(&rows)[axis] - truth[axis]).abs() < 0.002);
        assert!(one.cop_variance_m2(&rows)[axis].sqrt() < 0.3 * STANCE_SIGMA_M);
    }
    // The next stance is as unsure as a stance is, however many poses were learnt in the last.
    one.follow_stance(1, &settings);
    assert!(one.is_sound());
    let (error, sigma) = mean_error_m(&one, &person);
    for axis in 0..2 {
        assert!(sigma[axis] > STANCE_SIGMA_M);
        assert!(error[axis].abs() < 2.0 * sigma[axis], "{error:?} {sigma:?}");
    }

    // Poses in several stances tell the body from the stance.
    let mut many = worker(&person, &settings);
    for (index, posture) in postures().iter().enumerate() {
        let sign = [1.0, -1.0, -1.0, 1.0][index % 4];
        many.follow_stance(index as u64, &settings);
        learn(&mut many, &person, posture, off_m.map(|off| sign * off));
    }
    many.follow_stance(99, &settings);
    let (less_m, _) = mean_error_m(&many, &person);
    for axis in 0..2 {
        assert!(less_m[axis].abs() < 0.6 * error[axis].abs(), "{less_m:?} {error:?}");
    }
}

#[test]
fn where_the_position_is_absolute_a_stance_has_no_offset() {
    let (person, settings) = (Person::real(), Bench::new(|settings| settings.suit_drifts = false).settings);
    let mut one = worker(&person, &settings);
    for posture in postures() {
        learn(&mut one, &person, &posture, [0.0; 2]);
    }
    let before = *one;
    one.follow_stance(1, &settings);
    let (error, sigma) = mean_error_m(&one, &person);
    let (was, was_sigma) = mean_error_m(&before, &person);
    assert_eq!((error, sigma), (was, was_sigma));
    assert!(sigma.iter().all(|sigma| *sigma < 0.001) && error.iter().all(|error| error.abs() < 0.001));
}

#[test]
fn a_measurement_that_is_no_number_teaches_nothing() {
    let (person, settings) = (Person::real(), Bench::new(|_| {}).settings);
    let mut one = worker(&person, &settings);
    let before = bytemuck::bytes_of(&*one).to_vec();
    let rows = one.reduction.rows(&person.pose(&postures()[0]), [0.0; 2]);
    for (cop_m, variance_m2) in
        [([0.0, f64::NAN], [1e-6; 2]), ([0.0; 2], [1e-6, 0.0]), ([0.0; 2], [1e-6, f64::INFINITY])]
    {
        assert_eq!(one.take_in(&rows, cop_m, variance_m2), None);
    }
    assert_eq!(bytemuck::bytes_of(&*one), before);
}
