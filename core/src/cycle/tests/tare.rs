//! A tare while the suit streams.

use super::*;
use crate::motion::ForceSigma;

/// A bench whose plate is empty from now on, and reads this force.
fn empty(mut bench: Bench, person: &Person, zero_n: f64) -> Bench {
    (bench.disturbance.outside, bench.disturbance.zero_n) = (1.0, zero_n);
    bench.hold(person, &postures()[0], None, 1000);
    bench
}

#[test]
fn a_new_zero_is_no_jump_of_the_plate() {
    let person = Person::real();
    let mut bench = empty(Bench::new(|_| {}), &person, 100.0);
    bench.command(CommandKind::Tare);
    for _ in 0..500 {
        bench.hold(&person, &postures()[0], None, 1);
        assert!(!bench.state().validity().any_of(Validity::GROUND_IMPLAUSIBLE));
    }
    let newest = bench.memory.align.alignment.newest_ground().unwrap();
    assert!(newest.force_n[2].abs() < 1e-6, "{}", newest.force_n[2]);
    assert_eq!(bench.state().mass_kg, MASS_KG, "it was not weighed");
}

/// The bench after a subject without a known mass stood on a plate that reads this force when empty.
fn weighed(person: &Person, zero_n: f64) -> Bench {
    let mut bench = Bench::new(|settings| settings.mass_kg = None);
    bench.disturbance.zero_n = zero_n;
    bench.hold(person, &postures()[0], None, 4000);
    let expected_kg = MASS_KG + zero_n / GRAVITY_M_PER_S2;
    assert!((bench.state().mass_kg - expected_kg).abs() < 1e-6, "{}", bench.state().mass_kg);
    bench
}

#[test]
fn a_mass_that_contains_the_previous_zero_is_weighed_again() {
    let person = Person::real();
    for zero_n in [10.0, -10.0, 40.0] {
        let mut bench = empty(weighed(&person, zero_n), &person, zero_n);
        bench.command(CommandKind::Tare);
        bench.hold(&person, &postures()[0], None, 100);
        assert!(bench.state().validity().any_of(Validity::MASS_UNKNOWN), "{zero_n}");
        bench.disturbance.outside = 0.0;
        bench.hold(&person, &postures()[0], None, 4000);
        let state = bench.state();
        assert!((state.mass_kg - MASS_KG).abs() < 1e-6, "{zero_n}: {}", state.mass_kg);
        assert!(!state.validity().any_of(Validity::INVALIDATES_DELTA_F), "{:?}", state.validity());
        assert!(state.delta_f_n[2].abs() < 1e-3, "{zero_n}: {}", state.delta_f_n[2]);
    }
}

#[test]
fn a_zero_that_the_force_offset_has_tracked_is_no_part_of_the_mass() {
    let person = Person::real();
    let mut bench = weighed(&person, 0.0);
    let sigma = ForceSigma { at_rest_n: 2.0, by_motion_n: 0.0 };
    let (offset, mass_kg) = (&mut bench.memory.ground.force_offset, bench.memory.identification.mass_kg);
    offset.reset();
    offset.apply_mass(mass_kg, 5.0);
    for _ in 0..2000 {
        offset.update(7.0 - offset.mean_n(), 0.01, sigma);
    }
    assert!(offset.mean_n() > 6.0, "{}", offset.mean_n());
    let mut bench = empty(bench, &person, 7.0);
    bench.command(CommandKind::Tare);
    // A second one finds the zero of the first.
    bench.command(CommandKind::Tare);
    bench.hold(&person, &postures()[0], None, 100);
    assert!((bench.state().mass_kg - MASS_KG).abs() < 1e-6, "{}", bench.state().mass_kg);
}
