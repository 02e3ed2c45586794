//! Reads the bytes back by the table of the documentation alone.

use std::collections::HashMap;
use std::time::Duration;

use equipoise_client::{NoReading, Reading};
use equipoise_core::message::state::Unavailable;
use equipoise_core::message::{State, Validity};
use equipoise_gateways::gateway::Latest;
use equipoise_gateways::udp::encode::{Datagram, encode};

use crate::states::{reading, reasons, state};

const DOCUMENT: &str = include_str!("../../../../docs/consumers/udp.md");

/// A decoded row of the table: its numbers, and its group of values.
struct Row {
    numbers: Vec<f64>,
    group: String,
}

/// Decodes a little-endian number; returns it and its size in bytes.
fn number(kind: &str, bytes: &[u8]) -> (f64, usize) {
    match kind {
        "char" | "u8" => (f64::from(bytes[0]), 1),
        "u16" => (f64::from(u16::from_le_bytes(bytes[..2].try_into().unwrap())), 2),
        "u32" => (f64::from(u32::from_le_bytes(bytes[..4].try_into().unwrap())), 4),
        "u64" => (u64::from_le_bytes(bytes[..8].try_into().unwrap()) as f64, 8),
        "f32" => (f64::from(f32::from_le_bytes(bytes[..4].try_into().unwrap())), 4),
        other => panic!("{other} is no type"),
    }
}

/// Decodes a datagram by the documentation page alone.
fn by_the_documents(datagram: &[u8]) -> HashMap<String, Row> {
    let table = DOCUMENT.split("| offset |").nth(1).unwrap();
    let mut rows = HashMap::new();
    for line in table.lines().skip(2).take_while(|line| line.starts_with('|')) {
        let cells: Vec<_> = line.split('|').map(str::trim).collect();
        let (kind, shape) = cells[2].split_once('[').unwrap_or((cells[2], ""));
        let count = shape.split(['[', ']']).filter_map(|count| count.parse::<usize>().ok()).product();
        let mut at: usize = cells[1].parse().unwrap();
        let mut numbers = Vec::new();
        for _ in 0..count {
            let (value, bytes) = number(kind, &datagram[at..]);
            at += bytes;
            numbers.push(value);
        }
        rows.insert(cells[3].trim_matches('`').to_owned(), Row { numbers, group: cells[5].to_owned() });
    }
    assert!(rows.len() > 30, "{} rows", rows.len());
    rows
}

fn datagram(latest: &Latest) -> Vec<u8> {
    encode(&Datagram::new("cell-7", 1_700_000_000_000_000_000, 42, 3, latest)).to_vec()
}

fn with(change: impl FnOnce(&mut State)) -> Reading {
    let mut state = state();
    change(&mut state);
    reading(state)
}

#[test]
fn every_value_arrives_as_the_documents_say() {
    let state = state();
    let rows = by_the_documents(&datagram(&Ok(reading(state))));
    let decoded = |name: &str| rows[name].numbers.clone();
    let text: Vec<_> = b"EQPU".iter().map(|byte| f64::from(*byte)).collect();
    assert_eq!(decoded("magic"), text);
    assert_eq!(&decoded("station")[..7], b"cell-7\0".map(f64::from));
    assert_eq!(decoded("sequence"), [42.0]);
    assert_eq!(decoded("status"), [0.0]);
    assert_eq!(decoded("cycle"), [state.cycle as f64]);
    assert_eq!(decoded("state_time_ns"), [state.time_ns as f64]);
    assert_eq!(decoded("sample_time_ns"), [state.suit_sample_time_ns as f64]);
    assert_eq!(decoded("age_ns"), [1_234_567.0]);
    assert_eq!(decoded("sample_age_ns"), [71_234_567.0]);
    assert_eq!(decoded("worst_joint"), [21.0]);
    assert_eq!(decoded("flags"), [13.0]);
    assert_eq!(decoded("daemon_life"), [3.0]);
    assert_eq!(decoded("joint_level"), state.joint_level.map(f64::from));
    assert_eq!(decoded("torque_nm"), state.torque_nm.as_flattened());
    assert_eq!(decoded("torque_sigma_nm"), state.torque_sigma_nm);
    assert_eq!(decoded("torque_limit_nm"), state.torque_limit_nm);
    assert_eq!(decoded("fatigue"), state.fatigue);
    for (magnitude, torque) in decoded("torque_magnitude_nm").iter().zip(state.torque_nm) {
        let length = torque.iter().map(|value| value * value).sum::<f64>().sqrt();
        assert!((magnitude - length).abs() < 1e-6 * length, "{magnitude} is not the length of {torque:?}");
    }
    for (name, values) in [
        ("lifted_mass_kg", &[state.lifted_mass_kg][..]),
        ("lifted_mass_sigma_kg", &[state.lifted_mass_sigma_kg]),
        ("load_hand_distance_m", &[state.load_hand_distance_m]),
        ("reach_m", &[state.reach_m]),
        ("hand_load_fraction", &state.hand_load_fraction),
        ("advice_direction", &state.advice_direction),
        ("advice_gain_nm_per_cm", &[state.advice_gain_nm_per_cm]),
        ("delta_f_n", &state.delta_f_n),
        ("delta_f_sigma_n", &[state.delta_f_sigma_n]),
        ("ground_force_n", &state.ground_force_n),
        ("cop_measured_m", &state.cop_measured_m),
        ("cop_estimated_m", &state.cop_estimated_m),
        ("com_m", &state.com_m),
        ("l5s1_moment_nm", &[state.l5s1_moment_nm]),
        ("l5s1_moment_sigma_nm", &[state.l5s1_moment_sigma_nm]),
        ("l5s1_compression_n", &[state.l5s1_compression_n]),
        ("l5s1_compression_sigma_n", &[state.l5s1_compression_sigma_n]),
        ("dose_damage", &[state.dose_damage]),
        ("dose_probability", &[state.dose_probability]),
    ] {
        assert_eq!(decoded(name), values, "{name}");
    }
}

#[test]
fn what_a_reason_spoils_is_zero_and_has_no_bit_of_usable() {
    for valid in reasons() {
        let rows = by_the_documents(&datagram(&Ok(with(|state| state.valid = valid.0))));
        assert_eq!(rows["valid"].numbers, [valid.0 as f64]);
        let usable = rows["usable"].numbers[0] as u32;
        for (bit, (invalidating, name)) in Validity::FLAG_SETS.iter().enumerate() {
            let may = usable >> bit & 1 == 1;
            assert_eq!(
                may,
                !valid.any_of(*invalidating),
                "{name} with {:?}",
                valid.names().collect::<Vec<_>>()
            );
            let of_the_group = rows.iter().filter(|(_, row)| row.group == *name);
            for (field, row) in of_the_group {
                let any = row.numbers.iter().any(|value| *value != 0.0);
                assert_eq!(any, may, "{field} with {:?}", valid.names().collect::<Vec<_>>());
            }
        }
        assert_eq!(rows["worst_joint"].numbers[0] == f64::from(u32::MAX), valid != Validity::default());
    }
}

#[test]
fn a_force_that_is_not_measured_is_zero() {
    let rows = by_the_documents(&datagram(&Ok(with(|state| state.unavailable = Unavailable::Shear as u32))));
    assert_eq!(rows["unavailable"].numbers, [2.0]);
    assert_eq!(rows["ground_force_n"].numbers, [0.0, 0.0, state().ground_force_n[2]]);
}

#[test]
fn a_number_that_is_none_is_never_sent() {
    let rows = by_the_documents(&datagram(&Ok(with(|state| {
        state.reach_m = f64::NAN;
        state.delta_f_n = [f64::INFINITY, -1e300, 1.0];
    }))));
    assert_eq!(rows["reach_m"].numbers, [0.0]);
    assert_eq!(rows["delta_f_n"].numbers, [0.0, f64::from(f32::MIN), 1.0]);
}

#[test]
fn without_a_state_there_is_a_reason_and_nothing_that_may_be_used() {
    let ms = Duration::from_millis;
    for (why, status, about_ns) in [
        (NoReading::Silent { silent: ms(700) }, 1.0, 7e8),
        (NoReading::Stale { age: ms(40), stale_after: ms(25) }, 2.0, 4e7),
        (NoReading::OtherClock { ahead: ms(9000) }, 3.0, 9e9),
    ] {
        let rows = by_the_documents(&datagram(&Err(why)));
        assert_eq!(rows["status"].numbers, [status]);
        assert_eq!(rows["status_ns"].numbers, [about_ns]);
        assert_eq!(rows["usable"].numbers, [0.0]);
        assert_eq!(rows["daemon_life"].numbers, [3.0], "the last one received");
        for ages in ["age_ns", "sample_age_ns", "suit_age_ns", "ground_age_ns", "valid"] {
            assert_eq!(rows[ages].numbers, [u64::MAX as f64], "{ages}");
        }
        for (name, row) in rows.iter().filter(|(_, row)| !row.group.is_empty()) {
            assert!(row.numbers.iter().all(|value| *value == 0.0), "{name}");
        }
    }
}
