//! A tare while the suit streams.

use super::*;

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
    assert!(newest.force_n[2].abs() < 1e-9, "{}", newest.force_n[2]);
}
