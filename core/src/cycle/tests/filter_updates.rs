//! Identification from poses: stances, and the suit's errors.

extern crate std;
use std::boxed::Box;
use std::vec;
use std::vec::Vec;

use nalgebra::Vector3;

use super::bench::*;
use super::*;
use crate::anchor::STANCE_SIGMA_M;
use crate::frame::{Pose, StationWorld, SuitWorld};
use crate::sesc::centre_of_mass;
use crate::sesc::reduction::Rows;

/// A subject with known bone lengths and no other data.
pub(super) fn subject(person: &Person, settings: &Settings) -> Box<Identification> {
    let mut subject = bytemuck::zeroed_box::<Identification>();
    subject.start(settings);
    let pose = person.pose(&postures()[0]);
    let in_suit_world: Pose<SuitWorld> = Pose::new(pose.origin, pose.world_from_segment);
    for _ in 0..20 {
        subject.update_skeleton(&in_suit_world, settings);
    }
    assert!(subject.has_body());
    subject
}

/// The pose by the anchor in a stance with a position error of `off_m`.
fn off_by(pose: &Pose<StationWorld>, off_m: [f64; 2]) -> Pose<StationWorld> {
    Pose::new(
        pose.origin.map(|origin| origin + Vector3::new(off_m[0], off_m[1], 0.0)),
        pose.world_from_segment,
    )
}

fn measure(subject: &mut Identification, person: &Person, posture: &Posture, off_m: [f64; 2]) {
    let pose = person.pose(posture);
    let cop_m = centre_of_mass(&pose, &person.phi);
    let rows = subject.reduction.rows(&off_by(&pose, off_m), [0.0; 2]);
    subject.update_from_cop(&rows, [cop_m.x, cop_m.y], [1e-6; 2]).unwrap();
}

/// Mean error over all poses of a stance with a correct position, m, and the filter's σ.
fn mean_error_m(subject: &Identification, person: &Person) -> ([f64; 2], [f64; 2]) {
    let (mut error, mut sigma, count) = ([0.0; 2], [0.0; 2], postures().len() as f64);
    for posture in postures() {
        let pose = person.pose(&posture);
        let rows = subject.reduction.rows(&pose, [0.0; 2]);
        let (predicted, truth) = (subject.predict_cop_m(&rows), centre_of_mass(&pose, &person.phi));
        let variance = subject.cop_variance_m2(&rows);
        for axis in 0..2 {
            error[axis] += (predicted[axis] - truth[axis]) / count;
            sigma[axis] += variance[axis].sqrt() / count;
        }
    }
    (error, sigma)
}

#[test]
fn the_offset_of_a_stance_does_not_bias_theta() {
    let (person, settings) = (Person::real(), Bench::new(|_| {}).settings);
    let off_m = [0.006, -0.006];
    let mut one = subject(&person, &settings);
    for posture in postures() {
        measure(&mut one, &person, &posture, off_m);
    }
    // In the same stance, offset and body are determined together, far better than each separately.
    let pose = person.pose(&postures()[7]);
    let rows = one.reduction.rows(&off_by(&pose, off_m), [0.0; 2]);
    let truth = centre_of_mass(&pose, &person.phi);
    for axis in 0..2 {
        assert!((one.predict_cop_m(&rows)[axis] - truth[axis]).abs() < 0.002);
        assert!(one.cop_variance_m2(&rows)[axis].sqrt() < 0.3 * STANCE_SIGMA_M);
    }
    // The next stance has the full uncertainty of a stance, however many poses the last one had.
    one.update_stance(1, [STANCE_SIGMA_M; 2], &settings);
    assert!(one.is_sound());
    let (error, sigma) = mean_error_m(&one, &person);
    for axis in 0..2 {
        assert!(sigma[axis] > STANCE_SIGMA_M);
        assert!(error[axis].abs() < 2.0 * sigma[axis], "{error:?} {sigma:?}");
    }
}

#[test]
fn where_the_position_is_absolute_a_stance_has_no_offset() {
    let (person, settings) = (Person::real(), Bench::new(|settings| settings.suit_drifts = false).settings);
    let mut one = subject(&person, &settings);
    for posture in postures() {
        measure(&mut one, &person, &posture, [0.0; 2]);
    }
    let before = *one;
    one.update_stance(1, [STANCE_SIGMA_M; 2], &settings);
    let (error, sigma) = mean_error_m(&one, &person);
    let (was, was_sigma) = mean_error_m(&before, &person);
    assert_eq!((error, sigma), (was, was_sigma));
    assert!(sigma.iter().all(|sigma| *sigma < 0.001) && error.iter().all(|error| error.abs() < 0.001));
}

#[test]
fn a_non_finite_measurement_changes_nothing() {
    let (person, settings) = (Person::real(), Bench::new(|_| {}).settings);
    let mut one = subject(&person, &settings);
    let before = bytemuck::bytes_of(&*one).to_vec();
    let rows = one.reduction.rows(&person.pose(&postures()[0]), [0.0; 2]);
    for (cop_m, variance_m2) in
        [([0.0, f64::NAN], [1e-6; 2]), ([0.0; 2], [1e-6, 0.0]), ([0.0; 2], [1e-6, f64::INFINITY])]
    {
        assert_eq!(one.update_from_cop(&rows, cop_m, variance_m2), None);
    }
    assert_eq!(bytemuck::bytes_of(&*one), before);
}

/// Normal deviates from a seed (xorshift and Box–Muller), so that the tests need no crate.
pub(super) struct Normal(u64);

impl Normal {
    pub(super) fn seeded(seed: u64) -> Normal {
        // Neighbouring seeds must not give correlated streams.
        let mut normal = Normal(seed.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        for _ in 0..8 {
            normal.unit();
        }
        normal
    }

    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    pub(super) fn next(&mut self) -> f64 {
        let (radius, angle) = ((-2.0 * self.unit().ln()).sqrt(), core::f64::consts::TAU * self.unit());
        radius * angle.cos()
    }
}

/// θ drawn from the prior of a fresh subject's filter.
pub(super) fn drawn(subject: &Identification, normal: &mut Normal) -> Vec<f64> {
    let count = subject.filter.count();
    // Cholesky, row by row.
    let mut factor = vec![vec![0.0; count]; count];
    for row in 0..count {
        for column in 0..=row {
            let inner: f64 = (0..column).map(|k| factor[row][k] * factor[column][k]).sum();
            let rest = subject.filter.covariance_row_m2(row)[column] - inner;
            factor[row][column] =
                if row == column { rest.max(0.0).sqrt() } else { rest / factor[column][column] };
        }
    }
    let deviates: Vec<f64> = (0..count).map(|_| normal.next()).collect();
    (0..count)
        .map(|row| {
            subject.filter.theta_m()[row] + (0..=row).map(|k| factor[row][k] * deviates[k]).sum::<f64>()
        })
        .collect()
}

/// Measured CoP of a person with this θ in a stance with a position error, with noise of the stated size.
pub(super) fn simulated_cop_m(
    rows: &Rows,
    theta: &[f64],
    off_m: [f64; 2],
    variance_m2: [f64; 2],
    normal: &mut Normal,
) -> [f64; 2] {
    [0, 1].map(|axis| {
        let body: f64 = rows.h[axis].iter().zip(theta).map(|(h, theta)| h * theta).sum();
        rows.offset_m[axis] + body + off_m[axis] + variance_m2[axis].sqrt() * normal.next()
    })
}

/// A subject with this θ holds poses one after the other; returns the root mean square error of the CoP over the
/// library, for a known stance, after each.
fn errors_m(
    subject: &mut Identification,
    settings: &Settings,
    person: &Person,
    theta: &[f64],
    poses: usize,
    normal: &mut Normal,
) -> Vec<f64> {
    let variance_m2 = [9e-6; 2];
    let off_m = [0, 1].map(|_| STANCE_SIGMA_M * normal.next());
    let all = postures();
    (0..poses)
        .map(|index| {
            let rows = subject.reduction.rows(&person.pose(&all[(7 * index) % all.len()]), [0.0; 2]);
            let cop_m = simulated_cop_m(&rows, theta, off_m, variance_m2, normal);
            subject.update_from_rows(&rows, cop_m, variance_m2).unwrap();
            let mut square = 0.0;
            for posture in settings.library {
                let rows = subject.reduction.rows(&person.pose(posture), [0.0; 2]);
                let predicted = subject.predict_cop_m(&rows);
                for axis in 0..2 {
                    let body: f64 = rows.h[axis].iter().zip(theta).map(|(h, theta)| h * theta).sum();
                    let error = predicted[axis] - rows.offset_m[axis] - body - off_m[axis];
                    square += error * error / (2 * all.len()) as f64;
                }
            }
            square.sqrt()
        })
        .collect()
}

#[test]
fn a_correct_prior_is_rarely_inflated_and_its_innovations_match_their_sigma() {
    const PEOPLE: u64 = 400;
    let (person, settings) = (Person::real(), Bench::new(|_| {}).settings);
    let fresh = subject(&person, &settings);
    let (mut inflated, mut nis) = (0, 0.0);
    for seed in 0..PEOPLE {
        let (mut one, mut normal) = (fresh.clone(), Normal::seeded(seed));
        let theta = drawn(&one, &mut normal);
        errors_m(&mut one, &settings, &person, &theta, 6, &mut normal);
        nis += one.nis / PEOPLE as f64;
        inflated += u64::from(one.prior_inflation() > 1.0);
    }
    assert!(inflated * 20 < PEOPLE, "{inflated} of {PEOPLE}");
    // χ² of two degrees of freedom: mean 2, and 400 of them average to within 0.1.
    assert!((1.7..2.3).contains(&nis), "{nis}");
}

#[test]
fn a_wrong_prior_is_inflated_and_corrected_faster() {
    let (person, settings) = (Person::real(), Bench::new(|_| {}).settings);
    let fresh = subject(&person, &settings);
    let (mut with, mut without, mut inflated) = (0.0, 0.0, 0);
    for seed in 0..40 {
        let mut normal = Normal::seeded(seed);
        // Seven times as far from the table as the table's spread.
        let theta: Vec<f64> = drawn(&fresh, &mut normal)
            .into_iter()
            .zip(fresh.filter.theta_m())
            .map(|(drawn, mean)| mean + 7.0 * (drawn - mean))
            .collect();
        let (mut tested, mut accepting) = (fresh.clone(), fresh.clone());
        accepting.accept_prior();
        let mut same = Normal::seeded(seed + 1000);
        let mut again = Normal::seeded(seed + 1000);
        with += errors_m(&mut tested, &settings, &person, &theta, 5, &mut same)[4].powi(2);
        without += errors_m(&mut accepting, &settings, &person, &theta, 5, &mut again)[4].powi(2);
        assert!(tested.prior_inflation() <= 100.0 && tested.is_sound());
        inflated += u64::from(tested.prior_inflation() > 2.0);
        assert_eq!(accepting.prior_inflation(), 1.0);
    }
    assert!(inflated >= 36, "{inflated} of 40");
    assert!(with.sqrt() < 0.8 * without.sqrt(), "{} {}", with.sqrt(), without.sqrt());
}
