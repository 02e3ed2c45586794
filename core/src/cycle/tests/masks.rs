//! Flags that invalidate values, and values that are masked by them.

use super::*;
use crate::cycle::memory::SubjectState;
use crate::message::GroundDevice;

fn posture() -> Posture {
    stand(20, 0, [0, 0, -80], [0, 0, 80], 30)
}

#[test]
fn an_uncertain_time_masks_state_and_early_state() {
    let (person, mut bench) = (Person::real(), Bench::identified());
    bench.hold(&person, &posture(), None, 2500);
    let is_valid =
        |valid: Validity| !valid.any_of(Validity::INVALIDATES_DELTA_F.and(Validity::INVALIDATES_COM));
    let early = *bench.memory.early();
    assert!(is_valid(bench.state().validity()) && is_valid(early.validity()));
    assert!(early.cop_sigma_m[0] > 0.0 && early.delta_f_sigma_n > 0.0);

    bench.disturbance.time_sigma_ns = 30_000_000;
    bench.hold(&person, &posture(), None, 30);
    let (state, early) = (*bench.state(), *bench.memory.early());
    let is_masked = state.validity().any_of(Validity::CLOCK_UNSYNCHRONISED);
    assert!(is_masked, "its own time is certain, but not all of its window");
    assert!(early.validity().any_of(Validity::CLOCK_UNSYNCHRONISED), "{:?}", early.validity());
    assert_eq!((early.cop_estimated_m, early.cop_sigma_m), ([0.0; 2], [0.0; 2]));
    assert_eq!((early.delta_f_n, early.delta_f_sigma_n), ([0.0; 3], 0.0));
    assert_ne!(early.com_m, [0.0; 3], "by the suit alone");

    bench.hold(&person, &posture(), None, 200);
    let state = bench.state();
    assert!(state.validity().any_of(Validity::CLOCK_UNSYNCHRONISED), "{:?}", state.validity());
    assert_eq!((state.cop_estimated_m, state.cop_sigma_m), ([0.0; 2], [0.0; 2]));
    assert_eq!((state.delta_f_n, state.delta_f_sigma_n), ([0.0; 3], 0.0));
    assert_ne!((state.cop_measured_m[0], state.cop_measured_sigma_m[0]), (0.0, 0.0), "by the plate alone");
    assert_ne!(state.com_m, [0.0; 3]);
}

#[test]
fn the_time_errors_of_both_streams_add_up() {
    let is_unsynchronised = |[ground_ns, suit_ns]: [u64; 2]| {
        let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
        (bench.disturbance.time_sigma_ns, bench.disturbance.suit_time_sigma_ns) = (ground_ns, suit_ns);
        bench.hold(&person, &posture(), None, 1000);
        bench.state().validity().any_of(Validity::CLOCK_UNSYNCHRONISED)
    };
    assert!(is_unsynchronised([15_000_000; 2]), "the time between them has a σ of 21 ms");
    for sigmas_ns in [[13_000_000; 2], [19_000_000, 0], [0, 19_000_000]] {
        assert!(!is_unsynchronised(sigmas_ns), "{sigmas_ns:?}");
    }
    for sigmas_ns in [[u64::MAX, 0], [0, u64::MAX], [u64::MAX; 2]] {
        assert!(is_unsynchronised(sigmas_ns), "{sigmas_ns:?}");
    }
}

#[test]
fn a_measured_centre_of_pressure_has_its_sigma_and_a_masked_one_has_none() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.suit_silent = true;
    bench.hold(&person, &posture(), None, 500);
    let state = bench.state();
    assert!(!state.validity().any_of(Validity::INVALIDATES_COP_MEASURED));
    assert_ne!(state.cop_measured_m, [0.0; 2]);
    assert_eq!(state.cop_measured_sigma_m, [bench.settings.cop_sigma_m; 2]);
    bench.suit_silent = false;
    bench.hold(&person, &posture(), None, 1000);
    assert!(bench.state().cop_measured_sigma_m[0] > 0.0 && bench.state().delta_f_sigma_n > 0.0);
    bench.ground_silent = true;
    bench.hold(&person, &posture(), None, 300);
    let state = bench.state();
    assert!(state.validity().any_of(Validity::INVALIDATES_COP_MEASURED));
    assert_eq!((state.cop_measured_m, state.cop_measured_sigma_m), ([0.0; 2], [0.0; 2]));
    assert_eq!((state.delta_f_n, state.delta_f_sigma_n), ([0.0; 3], 0.0));
}

#[test]
fn without_a_body_there_is_no_external_force() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    let mut without_body = 0;
    for _ in 0..1000 {
        bench.hold(&person, &posture(), None, 1);
        let state = bench.state();
        if state.validity().any_of(Validity::BODY_UNKNOWN) {
            without_body += 1;
            assert!(Validity::INVALIDATES_DELTA_F.any_of(state.validity()));
            assert!(Validity::INVALIDATES_DELTA_F.any_of(Validity::BODY_UNKNOWN));
            assert_eq!(state.delta_f_n, [0.0; 3]);
        }
    }
    assert!(without_body > 100);
}

#[test]
fn values_of_the_previous_subject_are_not_published_after_a_load() {
    let (person, mut bench, mut other) = (Person::real(), Bench::identified(), Bench::new(|_| {}));
    bench.hold(&person, &posture(), None, 2500);
    other.hold(&person, &posture(), None, 500);
    other.command(CommandKind::IdentifyStop);
    other.hold(&person, &posture(), None, 500);
    let (before_m, expected_m) = (bench.state().com_m, other.state().com_m);
    assert!((before_m[0] - expected_m[0]).abs() > 0.005, "{before_m:?} {expected_m:?}");
    let subject =
        SubjectState { identification: other.memory.identification, exposure: other.memory.exposure };
    // Otherwise it would move the anchor, and with it the next subject.
    bench.memory.identification.reset_stance_offset([0.0; 2]);
    bench.memory.replace_subject(&subject);
    bench.command(CommandKind::SubjectLoad);
    let (mut published, mut published_early) = (0, 0);
    for _ in 0..2000 {
        let (state, early) = (bench.state(), bench.memory.early());
        if !state.validity().any_of(Validity::INVALIDATES_COM) {
            published += 1;
            assert!((state.com_m[0] - expected_m[0]).abs() < 0.002, "{:?} {expected_m:?}", state.com_m);
        }
        if !early.validity().any_of(Validity::INVALIDATES_COM) {
            published_early += 1;
            assert!((early.com_m[0] - expected_m[0]).abs() < 0.002, "{:?} {expected_m:?}", early.com_m);
        }
        bench.hold(&person, &posture(), None, 1);
    }
    assert!(published > 1800 && published_early > 1500, "{published} {published_early}");
}

#[test]
fn insoles_need_no_registration_with_a_load_and_a_plate_does() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    bench.disturbance.devices = GroundDevice::Insoles as u32;
    bench.identify(&person);
    let at = lifted_box(&person, &posture());
    bench.hold(&person, &posture(), None, 1000);
    bench.hold(&person, &posture(), Some((10.0, at)), 1000);
    bench.memory.invalidate_registration();
    for _ in 0..1000 {
        bench.hold(&person, &posture(), Some((10.0, at)), 1);
        assert!(!bench.state().validity().any_of(Validity::POSITION_UNKNOWN));
    }
    assert!(bench.state().suit_com_m().is_some());
    bench.disturbance.devices = GroundDevice::Plate as u32;
    bench.hold(&person, &posture(), Some((10.0, at)), 200);
    let state = bench.state();
    assert!(state.validity().any_of(Validity::POSITION_UNKNOWN));
    assert_eq!((state.suit_com_m(), state.suit_com_m), (None, [0.0; 3]), "masked: it is in the suit world");
    assert!(state.segment_origin_m().is_some(), "the figure is displayed");
}

#[test]
fn a_suit_that_restarts_with_its_adapter_is_elsewhere_and_one_with_an_invalid_counter_is_not() {
    let person = Person::real();
    // Silent for `gap_ms`, then with a counter from zero for `restarted_ms`. The session is always 0.
    let is_lost = |gap_ms: u64, restarted_ms: u64| {
        let mut bench = Bench::new(|_| {});
        bench.hold(&person, &posture(), None, 1000);
        bench.suit_silent = true;
        bench.hold(&person, &posture(), None, gap_ms);
        (bench.suit_silent, bench.suit_started_ns) = (false, bench.now_ns);
        bench.hold(&person, &posture(), None, restarted_ms);
        let is_lost = bench.state().validity().any_of(Validity::POSITION_UNKNOWN);
        bench.suit_started_ns = 0;
        bench.hold(&person, &posture(), None, 200);
        assert_eq!(bench.state().validity().any_of(Validity::POSITION_UNKNOWN), is_lost);
        is_lost
    };
    assert!(is_lost(2000, 300) && is_lost(0, 300));
    for gap_ms in [0, 200, 2000] {
        assert!(!is_lost(gap_ms, 10), "one invalid counter after {gap_ms} ms");
    }
}

#[test]
fn an_invalid_counter_at_the_start_of_a_suit_is_no_restart() {
    let (person, mut bench) = (Person::real(), Bench::new(|_| {}));
    for (started_ns, milliseconds) in [(bench.now_ns, 300), (0, 10), (bench.now_ns, 200)] {
        bench.suit_started_ns = started_ns;
        bench.hold(&person, &posture(), None, milliseconds);
    }
    assert!(!bench.state().validity().any_of(Validity::POSITION_UNKNOWN), "it is higher, then as before");
}

/// Arms that hang: the hands are near the centre of pressure, where another gain of the plate resembles a load.
fn hanging() -> Posture {
    stand(0, 0, [-80, 0, 0], [80, 0, 0], 0)
}

/// An identified subject without a load.
fn identified(person: &Person) -> Bench {
    let mut bench = Bench::new(|_| {});
    bench.identify(person);
    bench.hold(person, &hanging(), None, 2500);
    bench
}

/// The plate is silent for half a second and has this gain afterwards. Returns the number of cycles with valid torques
/// in the two seconds after it.
fn after_a_gap(bench: &mut Bench, person: &Person, gain_error: f64, load_kg: f64) -> u32 {
    let load = (load_kg > 0.0).then(|| (load_kg, lifted_box(person, &hanging())));
    bench.ground_silent = true;
    bench.hold(person, &hanging(), load, 500);
    bench.ground_silent = false;
    bench.disturbance.gain_error = gain_error;
    let mut valid = 0;
    for _ in 0..2000 {
        bench.hold(person, &hanging(), load, 1);
        valid += u32::from(!bench.state().validity().any_of(Validity::INVALIDATES_TORQUES));
    }
    valid
}

#[test]
fn a_gain_that_changed_over_a_gap_is_no_load_until_the_weight_alone_was_measured() {
    let person = Person::real();
    for gain_error in [0.5, 1.0] {
        let mut bench = identified(&person);
        assert_eq!(after_a_gap(&mut bench, &person, gain_error, 0.0), 0);
        let state = bench.state();
        assert!(state.validity().any_of(Validity::GROUND_IMPLAUSIBLE), "{:?}", state.validity());
        assert_eq!((state.delta_f_n[2], state.lifted_mass_kg), (0.0, 0.0));

        after_a_gap(&mut bench, &person, 0.0, 0.0);
        let valid = bench.state().validity();
        assert!(!valid.any_of(Validity::GROUND_IMPLAUSIBLE), "{valid:?}");
        assert!(valid.any_of(Validity::BELOW_LOAD_THRESHOLD), "{valid:?}");
        let at = lifted_box(&person, &hanging());
        bench.hold(&person, &hanging(), Some((6.0, at)), 2000);
        let valid = bench.state().validity();
        assert!(!valid.any_of(Validity::INVALIDATES_TORQUES), "the gain is confirmed: {valid:?}");
    }
}

#[test]
fn a_sample_of_unknown_time_does_not_admit_another_gain() {
    let person = Person::real();
    let mut bench = identified(&person);
    let at = lifted_box(&person, &hanging());
    bench.hold(&person, &hanging(), Some((6.0, at)), 3000);
    // The force changes meanwhile: at rest its time has no effect.
    bench.disturbance.time_sigma_ns = u64::MAX;
    bench.hold(&person, &hanging(), None, 200);
    bench.disturbance.time_sigma_ns = 0;
    bench.hold(&person, &hanging(), None, 1000);
    assert_eq!(after_a_gap(&mut bench, &person, 0.5, 0.0), 0);
}

#[test]
fn after_a_change_of_a_clock_epoch_a_measured_lag_is_unknown_at_rest() {
    let person = Person::real();
    for stream in 0..2 {
        let mut bench = identified(&person);
        let is_masked = |bench: &mut Bench| {
            bench.disturbance.clock_epoch[stream] += 1;
            bench.hold(&person, &hanging(), None, 1000);
            bench.state().validity().any_of(Validity::CLOCK_UNSYNCHRONISED)
        };
        assert!(!is_masked(&mut bench), "no lag was measured");
        bench.memory.align.skew.resume(0.004, 0.0);
        assert!(is_masked(&mut bench), "stream {stream}");
    }
}

#[test]
fn the_doubt_about_a_gain_remains_with_another_subject() {
    let person = Person::real();
    let mut bench = identified(&person);
    assert_eq!(after_a_gap(&mut bench, &person, 0.5, 0.0), 0);
    let subject = SubjectState { identification: bench.memory.identification, exposure: Zeroable::zeroed() };
    bench.memory.replace_subject(&subject);
    bench.command(CommandKind::SubjectLoad);
    for _ in 0..4000 {
        bench.hold(&person, &hanging(), None, 1);
        assert!(bench.state().validity().any_of(Validity::INVALIDATES_TORQUES), "a gain is no load");
    }
}

#[test]
fn the_load_from_before_a_gap_of_the_plate_is_valid_after_it_and_another_one_is_not() {
    let person = Person::real();
    let mut bench = identified(&person);
    let at = lifted_box(&person, &hanging());
    bench.hold(&person, &hanging(), Some((6.0, at)), 4000);
    assert!(after_a_gap(&mut bench, &person, 0.0, 6.0) > 1000, "the same load");
    assert_eq!(after_a_gap(&mut bench, &person, 0.0, 12.0), 0, "taken in the gap");
    bench.hold(&person, &hanging(), None, 1500);
    bench.hold(&person, &hanging(), Some((12.0, at)), 2000);
    let valid = bench.state().validity();
    assert!(!valid.any_of(Validity::INVALIDATES_TORQUES), "taken again: {valid:?}");
}

#[test]
fn a_load_that_no_person_holds_is_implausible() {
    let person = Person::real();
    let mut bench = identified(&person);
    bench.takes_ms = 1500.0;
    let at = lifted_box(&person, &hanging());
    for (kg, is_implausible) in [(150.0, false), (260.0, true)] {
        bench.hold(&person, &hanging(), Some((kg, at)), 2500);
        let state = bench.state();
        let valid = state.validity();
        assert_eq!(valid.any_of(Validity::GROUND_IMPLAUSIBLE), is_implausible, "{kg} kg: {valid:?}");
        assert_eq!(state.lifted_mass_kg == 0.0, valid.any_of(Validity::INVALIDATES_LIFTED_MASS));
    }
}
