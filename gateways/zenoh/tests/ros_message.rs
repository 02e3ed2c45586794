//! Decodes the gateway's messages field by field, by the definitions in `clients/ros2`.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

mod msg;

use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_client::{NoReading, Reading};
use equipoise_core::body::Joint;
use equipoise_core::message::{State, Validity};
use equipoise_gateway_zenoh::ros::state_message;
use equipoise_gateways::Latest;
use equipoise_view::state_json::StateJson;
use msg::{Definitions, Many};
use serde_json::{Map, Value, json};

/// Decodes little-endian CDR by the definitions.
struct Reader<'a> {
    all: &'a Definitions,
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        self.at = self.at.next_multiple_of(N);
        let taken = self.bytes[self.at..self.at + N].try_into().unwrap();
        self.at += N;
        taken
    }

    fn message(&mut self, name: &str) -> Value {
        let mut map = Map::new();
        for field in self.all[name].clone() {
            let value = match field.many {
                Many::One => self.one(&field.of),
                Many::Array(count) => self.many(&field.of, count),
                Many::Bounded(most) => {
                    let count = self.count();
                    assert!(count <= most, "{name}.{} holds {count}, at most {most} may be", field.name);
                    self.many(&field.of, count)
                }
                Many::Unbounded => {
                    let count = self.count();
                    self.many(&field.of, count)
                }
            };
            map.insert(field.name, value);
        }
        Value::Object(map)
    }

    fn count(&mut self) -> usize {
        u32::from_le_bytes(self.take()) as usize
    }

    fn many(&mut self, of: &str, count: usize) -> Value {
        (0..count).map(|_| self.one(of)).collect()
    }

    fn one(&mut self, of: &str) -> Value {
        match of {
            "uint8" => json!(self.take::<1>()[0]),
            "bool" => match self.take::<1>()[0] {
                0 => json!(false),
                1 => json!(true),
                other => panic!("{other} is no bool"),
            },
            "int32" => json!(i32::from_le_bytes(self.take())),
            "uint32" => json!(u32::from_le_bytes(self.take())),
            "uint64" => json!(u64::from_le_bytes(self.take())),
            "float64" => json!(f64::from_le_bytes(self.take())),
            "string" => {
                let length = self.count();
                let text = &self.bytes[self.at..self.at + length];
                self.at += length;
                assert_eq!(text.last(), Some(&0));
                json!(std::str::from_utf8(&text[..length - 1]).unwrap())
            }
            message => self.message(message),
        }
    }
}

fn read(bytes: &[u8]) -> Value {
    let all = msg::definitions();
    assert_eq!(bytes[..4], [0, 1, 0, 0]);
    let mut reader = Reader { all: &all, bytes: &bytes[4..], at: 0 };
    let value = reader.message("equipoise_msgs/msg/State");
    assert_eq!(reader.at, reader.bytes.len(), "bytes are left over");
    value
}

/// A state with all numbers different.
fn full_state() -> State {
    let mut state = State { cycle: 71, phase: 2, worst_joint: 3, lifts: 4, mass_kg: 72.5, ..State::zeroed() };
    state.torque_nm = std::array::from_fn(|joint| [joint as f64, joint as f64 + 0.25, -(joint as f64)]);
    state.torque_sigma_nm = std::array::from_fn(|joint| 0.5 + joint as f64);
    state.torque_limit_nm = std::array::from_fn(|joint| 100.0 + joint as f64);
    state.joint_level = std::array::from_fn(|joint| joint as u32 % 6);
    state.fatigue = std::array::from_fn(|joint| joint as f64 / 100.0);
    state.hand_load_fraction = [0.4, 0.6];
    state.reach_m = 0.45;
    state.advice_direction = [0.6, 0.0, -0.8];
    state.advice_gain_nm_per_cm = 1.75;
    state.l5s1_moment_nm = 120.0;
    state.l5s1_moment_sigma_nm = 9.0;
    state.l5s1_compression_n = 3100.0;
    state.l5s1_compression_sigma_n = 310.0;
    state.lifted_mass_kg = 8.25;
    state.lifted_mass_sigma_kg = 0.125;
    state.delta_f_n = [1.0, 2.0, 81.0];
    state.delta_f_sigma_n = 1.5;
    state.cop_measured_m = [0.01, 0.02];
    state.cop_measured_sigma_m = [0.001, 0.002];
    state.cop_estimated_m = [0.03, 0.04];
    state.cop_sigma_m = [0.003, 0.004];
    state.ground_force_n = [3.0, 4.0, 790.0];
    state
}

fn latest(state: State) -> Latest {
    Ok(Reading {
        state,
        received_ns: 0,
        age_ns: 2_000_000,
        sample_age_ns: Some(40_000_000),
        missed: 0,
        restarted: false,
        daemon_life: 1,
        is_new: true,
    })
}

const NOW_UNIX_NS: u64 = 1_700_000_000_001_000_000;

fn written(latest: &Latest) -> Value {
    read(&state_message("station-1", 9, NOW_UNIX_NS, latest, true))
}

#[test]
fn every_value_arrives_in_the_field_that_the_definition_gives_it() {
    let state = full_state();
    let message = written(&latest(state));
    let json = serde_json::to_value(StateJson::new(&state, 0.0)).unwrap();
    assert_eq!(message["header"]["stamp"], json!({"sec": 1_699_999_999, "nanosec": 999_000_000}));
    assert_eq!(message["header"]["frame_id"], "equipoise/station_1");
    assert_eq!((&message["station"], &message["sequence"]), (&json!("station-1"), &json!(9)));
    assert_eq!((&message["current"], &message["no_state_reason"]), (&json!(true), &json!("")));
    assert_eq!(message["cycle"], json!([71]));
    assert_eq!(message["age_ns"], json!([2_000_000]));
    assert_eq!(message["sample_age_ns"], json!([40_000_000]));
    assert_eq!((&message["phase"], &message["reasons"]), (&json["phase"], &json!([])));
    let overload = &message["overload"][0];
    for joint in overload["joints"].as_array().unwrap() {
        let expected = &json["joints"][joint["name"].as_str().unwrap()];
        assert_eq!(joint["torque_nm"], expected["torque_nm"]);
        assert_eq!(joint["sigma_nm"], expected["sigma_nm"]);
        assert_eq!(joint["limit_nm"], json!([expected["limit_nm"]]));
        let names = ["none", "green", "orange", "red", "above_max", "undecided"];
        assert_eq!(names[joint["level"].as_u64().unwrap() as usize], expected["level"]);
    }
    assert_eq!(overload["joints"].as_array().unwrap().len(), Joint::ALL.len());
    assert_eq!(overload["worst_joint"], json["worst_joint"]);
    assert_eq!(overload["hand_load_fraction"], json["hand_load_fraction"]);
    assert_eq!(overload["reach_m"], json["reach_m"]);
    assert_eq!(overload["advice"], json!([{"direction": [0.6, 0.0, -0.8], "gain_nm_per_cm": 1.75}]));
    for key in ["l5s1_moment_nm", "l5s1_moment_sigma_nm", "l5s1_compression_n", "l5s1_compression_sigma_n"] {
        assert_eq!(message["low_back"][0][key], json[key], "{key}");
    }
    assert_eq!(message["load"], json!([{"mass_kg": 8.25, "sigma_kg": 0.125}]));
    assert_eq!(message["external_force"], json!([{"force_n": json["delta_f_n"], "vertical_sigma_n": [1.5]}]));
    assert_eq!(message["cop_measured"], json!([{"position_m": [0.01, 0.02], "sigma_m": [0.001, 0.002]}]));
    assert_eq!(message["cop_estimated"], json!([{"position_m": [0.03, 0.04], "sigma_m": [0.003, 0.004]}]));
    assert_eq!((&message["vertical_force_n"], &message["mass_kg"]), (&json!([790.0]), &json!([72.5])));
    assert_eq!(message["fatigue"].as_array().unwrap().len(), Joint::ALL.len());
    assert_eq!(message["fatigue"][5]["fatigue"], json!(0.05));
}

// Reference: the JSON, which has tests of its own. Fields absent there must be empty here.
#[test]
fn each_reason_empties_what_it_spoils_and_nothing_else() {
    let pairs = [
        ("joints", "overload"),
        ("l5s1_moment_nm", "low_back"),
        ("lifted_mass_kg", "load"),
        ("delta_f_n", "external_force"),
        ("cop_measured", "cop_measured"),
        ("cop_estimated", "cop_estimated"),
        ("vertical_force_n", "vertical_force_n"),
        ("mass_kg", "mass_kg"),
    ];
    for (reason, name) in Validity::NAMES {
        let state = State { valid: reason.0, ..full_state() };
        let (message, json) =
            (written(&latest(state)), serde_json::to_value(StateJson::new(&state, 0.0)).unwrap());
        assert_eq!(message["reasons"], json!([name]));
        for (key, field) in pairs {
            let is_present = !message[field].as_array().unwrap().is_empty();
            assert_eq!(is_present, json.get(key).is_some(), "{field} under {name}");
        }
    }
}

#[test]
fn silence_has_its_reason_and_no_value_at_all() {
    let message = written(&Err(NoReading::Silent { silent: Duration::from_secs(1) }));
    assert_eq!((&message["current"], &message["no_state_reason"]), (&json!(false), &json!("silent")));
    assert_eq!((&message["phase"], &message["sequence"]), (&json!(""), &json!(9)));
    for (name, value) in message.as_object().unwrap() {
        assert!(value.as_array().is_none_or(Vec::is_empty), "{name} is {value}");
    }
}

#[test]
fn what_is_no_number_is_not_there() {
    let mut state = full_state();
    state.torque_nm[2][1] = f64::NAN;
    state.cop_measured_m[0] = f64::NAN;
    state.l5s1_moment_nm = f64::INFINITY;
    let message = written(&latest(state));
    assert_eq!(message["overload"][0]["joints"].as_array().unwrap().len(), Joint::ALL.len() - 1);
    assert_eq!((&message["cop_measured"], &message["low_back"]), (&json!([]), &json!([])));
}
