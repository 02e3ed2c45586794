//! Measured shear: an external horizontal force, and a foot next to the plate.

use super::*;
use crate::sesc::centre_of_mass;

fn posture() -> Posture {
    stand(10, 0, [0, 0, -80], [0, 0, 80], 30)
}

/// An identified subject who stands; the plate never measures exactly zero.
fn standing(person: &Person) -> Bench {
    // The bench changes poses abruptly without the corresponding shear, so shear is added after identification.
    let mut bench = Bench::identified();
    bench.hold(person, &posture(), None, 1000);
    bench.disturbance.shear_n = [0.5, 0.0];
    bench.hold(person, &posture(), None, 2500);
    bench
}

/// Changes the disturbance over half a second: an abrupt change would be rejected as implausible.
fn change(bench: &mut Bench, person: &Person, to: Disturbance) {
    let from = bench.disturbance;
    for step in 1..=50 {
        let part = |from: f64, to: f64| from + f64::from(step) / 50.0 * (to - from);
        bench.disturbance = Disturbance {
            shear_n: [0, 1].map(|axis| part(from.shear_n[axis], to.shear_n[axis])),
            push_n: part(from.push_n, to.push_n),
            outside: part(from.outside, to.outside),
            ..to
        };
        bench.hold(person, &posture(), None, 10);
    }
}

/// Asserts that every valid estimate is within 3 σ of the truth; returns the number of valid ones.
fn check_estimates(bench: &mut Bench, person: &Person, milliseconds: u32) -> u32 {
    let truth = centre_of_mass(&person.pose(&posture()), &person.phi);
    let mut valid = 0;
    for _ in 0..milliseconds {
        bench.hold(person, &posture(), None, 1);
        let state = bench.state();
        assert!(!state.validity().any_of(Validity::IMPLAUSIBLE), "the shear is not suspect");
        if !state.validity().any_of(Validity::INVALIDATES_COP_ESTIMATED) {
            valid += 1;
            for (axis, truth_m) in [truth.x, truth.y].into_iter().enumerate() {
                let error_m = (state.cop_estimated_m[axis] - truth_m).abs();
                let sigma_m = state.cop_sigma_m[axis];
                assert!(error_m <= 3.0 * sigma_m && sigma_m < 0.02, "{valid} {axis}: {error_m} {sigma_m}");
            }
        }
    }
    valid
}

#[test]
fn a_push_does_not_shift_the_estimate_after_its_end() {
    let person = Person::real();
    let mut bench = standing(&person);
    let before = bench.disturbance;
    assert!(check_estimates(&mut bench, &person, 500) > 400);
    change(&mut bench, &person, Disturbance { push_n: 100.0, ..before });
    assert!(check_estimates(&mut bench, &person, 5000) > 4000, "the suit's acceleration is used");
    change(&mut bench, &person, before);
    assert!(check_estimates(&mut bench, &person, 8000) > 7000);
}

#[test]
fn the_constant_shear_of_a_tilted_plate_is_subtracted() {
    let person = Person::real();
    let mut bench = standing(&person);
    // Corresponds to a tilt of 0.9°.
    change(&mut bench, &person, Disturbance { shear_n: [11.0, 0.0], ..Disturbance::default() });
    bench.hold(&person, &posture(), None, 30_000);
    assert!(check_estimates(&mut bench, &person, 1000) > 900);
}

#[test]
fn the_shear_under_one_foot_is_not_the_acceleration_of_the_body() {
    let person = Person::real();
    let mut bench = standing(&person);
    let one_foot = Disturbance { shear_n: [0.5, -22.0], outside: 0.4, ..Disturbance::default() };
    change(&mut bench, &person, one_foot);
    assert!(check_estimates(&mut bench, &person, 3000) > 2500);
    assert!(bench.state().validity().any_of(Validity::WEIGHT_MISSING));
}
