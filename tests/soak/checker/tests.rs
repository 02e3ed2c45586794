//! Tests of the checker: a wrong value is reported, and a verdict needs enough checked values.

use equipoise_simulator::settings::SimulationSettings;
use equipoise_simulator::simulation::Simulation;

use super::*;

#[test]
fn a_wrong_value_is_found_unless_a_reason_is_given() {
    let mut settings = SimulationSettings::default();
    settings.suit.target.set_port(9);
    settings.plate.address.set_port(0);
    let person = Simulation::start(settings).expect("a simulated person");
    std::thread::sleep(std::time::Duration::from_millis(200));
    let now_ns = person.sent_ns()[0];
    let truth = person.truth_at((now_ns - person.start_ns()) as f64 * 1e-9);
    let true_state = State {
        cycle: 1,
        time_ns: now_ns,
        suit_sample_time_ns: now_ns,
        ground_age_ns: u64::MAX,
        cop_measured_m: truth.cop_m.into(),
        ground_force_n: truth.ground.force_n.into(),
        com_m: truth.com_m.into(),
        cop_estimated_m: truth.cop_without_load_in_motion_m.into(),
        segment_origin_m: truth.body.origin_m.map(Into::into),
        l5s1_moment_nm: truth.back.moment_nm.xy().norm(),
        l5s1_compression_n: truth.back.moment_nm.xy().norm() / EXTENSOR_LEVER_M + truth.back.axial_n,
        ..State::zeroed()
    };
    let mut checker = Checker::new();
    // This test must not depend on whether the host delays the sensors now.
    let mut wrong_values = |state: State, held_up: [bool; 2]| {
        (checker.state, checker.held_up) = (state, held_up);
        checker.values(&person);
        checker.wrong.iter().map(|wrong| wrong.what).collect::<Vec<_>>()
    };
    assert_eq!(wrong_values(true_state, [false; 2]), [""; 0]);
    let off = State { cycle: 2, cop_measured_m: [truth.cop_m.x + 0.05, truth.cop_m.y], ..true_state };
    assert_eq!(
        wrong_values(State { valid: Validity::FEET_OFF_PLATE.0, ..off }, [false; 2]),
        [""; 0],
        "withheld"
    );
    assert_eq!(wrong_values(off, GROUND), [""; 0], "the plate is held up");
    assert_eq!(wrong_values(off, SUIT), ["measured cop"], "the plate's value needs no suit");
    assert_eq!(wrong_values(State { cycle: 3, ..off }, [false; 2]), ["measured cop"; 2]);
    checker.check(State { cycle: 4, time_ns: now_ns + 900_000_000, suit_age_ns: 0, ..true_state }, &person);
    let found: Vec<_> = checker.wrong.iter().map(|wrong| wrong.what).collect();
    assert!(found.contains(&"suit's age") && found.contains(&"suit's silence"), "{found:?}");
    checker.required_reason = Some(Validity::SUIT_STALE);
    checker.check(State { cycle: 5, ..true_state }, &person);
    assert_eq!(checker.wrong.last().map(|wrong| wrong.what), Some("another clock"));
    let wrong = checker.wrong.len();
    checker.check(State { cycle: 6, valid: Validity::SUIT_STALE.0, ..true_state }, &person);
    assert_eq!(checker.wrong.len(), wrong, "{:?}", checker.report());
}

#[test]
fn a_verdict_needs_enough_of_every_value() {
    let mut checker = Checker::new();
    checker.begin_to_count();
    assert_eq!(checker.insufficient(), None);
    checker.states = 1000;
    checker.published = VALUES.map(|value| (value, 200)).into();
    assert_eq!(checker.insufficient(), None);
    checker.missed = 21;
    assert!(checker.insufficient().is_some_and(|reason| reason.contains("21 states were missed")));
    checker.missed = 20;
    checker.published.insert("torques", 199);
    assert!(checker.insufficient().is_some_and(|reason| reason.contains("torques")));
    checker.published.remove("torques");
    assert!(checker.insufficient().is_some_and(|reason| reason.contains("torques")), "never checked");
}
