//! Properties of the published values: a good status has a value, any other has none, and both time stamps agree.

#[path = "support/mod.rs"]
mod support;

use equipoise_core::message::Validity;
use equipoise_gateway_opcua::table::About;
use equipoise_gateway_opcua::values::{Clocks, of_latest, rows};
use opcua::types::{DataValue, DateTimeUtc, StatusCode, Variant};

use support::{reading, silence};

fn is_good(value: &DataValue) -> bool {
    value.status == Some(StatusCode::Good)
}

#[test]
fn a_status_is_good_if_and_only_if_there_is_a_value() {
    let every_reason =
        Validity::NAMES.iter().map(|(reason, _)| *reason).chain([Validity(0), Validity(0x1fff)]);
    for raised in every_reason {
        for value in of_latest(&Ok(reading(raised)), true, Clocks::now()) {
            assert_eq!(is_good(&value), value.value != Some(Variant::Empty), "{raised:?}: {value:?}");
            assert!(value.status.is_some_and(|status| status.is_good() || status.is_bad()), "{value:?}");
            assert_eq!(is_good(&value), value.source_timestamp.is_some(), "{value:?}");
            assert!(value.server_timestamp.is_some());
        }
    }
    for ever in [false, true] {
        assert!(of_latest(&silence(), ever, Clocks::now()).iter().all(|value| !is_good(value)));
    }
}

#[test]
fn each_reason_withholds_what_it_spoils_and_nothing_else() {
    for (raised, name) in Validity::NAMES {
        let values = of_latest(&Ok(reading(*raised)), true, Clocks::now());
        for ((row, _), value) in rows().zip(&values) {
            assert_eq!(is_good(value), !raised.any_of(row.invalidating), "{} under {name}", row.name);
        }
    }
}

#[test]
fn silence_is_no_communication_and_before_the_first_state_a_wait() {
    let first = |ever| of_latest(&silence(), ever, Clocks::now())[0].status;
    assert_eq!(first(true), Some(StatusCode::BadNoCommunication));
    assert_eq!(first(false), Some(StatusCode::BadWaitingForInitialData));
}

#[test]
fn source_times_are_those_of_the_moment_by_the_wall_clock() {
    let clocks = Clocks { monotonic_ns: 5_000_000_000, utc_ns: 1_700_000_000_000_000_000 };
    let mut reading = reading(Validity(0));
    (reading.state.time_ns, reading.state.suit_sample_time_ns) = (4_998_000_000, 4_928_000_000);
    for ((row, _), value) in rows().zip(of_latest(&Ok(reading), true, clocks)) {
        let behind_ms = match row.about {
            About::Cycle => 2,
            About::Sample => 72,
        };
        let source: DateTimeUtc = value.source_timestamp.unwrap().into();
        assert_eq!(source.timestamp_millis(), 1_700_000_000_000 - behind_ms, "{}", row.name);
        let server: DateTimeUtc = value.server_timestamp.unwrap().into();
        assert_eq!(server.timestamp_millis(), 1_700_000_000_000);
    }
    let clocks = Clocks::now();
    let utc: DateTimeUtc = clocks.utc(clocks.monotonic_ns).into();
    let apart_ms = (utc.timestamp_millis() - clocks.utc_ns as i64 / 1_000_000).abs();
    assert!(apart_ms <= 1, "{apart_ms} ms");
}

#[test]
fn a_value_that_is_not_a_number_is_not_published() {
    let mut reading = reading(Validity(0));
    reading.state.lifted_mass_kg = f64::NAN;
    reading.state.torque_nm[3][1] = f64::INFINITY;
    reading.state.joint_level[4] = 0;
    reading.state.worst_joint = u32::MAX;
    let values = of_latest(&Ok(reading), true, Clocks::now());
    let bad: Vec<_> = rows().zip(&values).filter(|(_, value)| !is_good(value)).collect();
    let names: Vec<_> = bad.iter().map(|((row, _), _)| row.name).collect();
    assert_eq!(names, ["WorstJoint", "LiftedMass", "Torque", "TorqueMagnitude", "Level"]);
}
