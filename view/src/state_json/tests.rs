//! Tests of the exact JSON text, and of keys that are left out.

use super::schema::{KEYS, Key, Presence};
use super::*;
use crate::schema_check::misfits;
use bytemuck::Zeroable;
use equipoise_core::cycle::BodyRejection;
use equipoise_core::message::state::Phase;
use serde_json::Value;

/// A state with all values.
pub(crate) fn monitoring() -> State {
    let mut state = State::zeroed();
    state.cycle = 7;
    state.phase = Phase::Monitoring as u32;
    state.suit_sample_time_ns = 1;
    state.suit_age_ns = 4_000_000;
    state.ground_age_ns = 900_000;
    state.static_pose = 1;
    state.converged = 1;
    state.poses_used = 12;
    state.stance = 2;
    state.suggested_pose = u32::MAX;
    state.mass_kg = 72.5;
    state.cop_measured_m = [0.0625, -0.01];
    state.cop_estimated_m = [0.03, -0.02];
    state.cop_sigma_m = [0.004, 0.005];
    state.com_m = [0.03, -0.02, 0.98];
    state.suit_com_m = [0.04, -0.02, 0.97];
    (state.body_source, state.foot_outline_source, state.ground_devices) = (2, 1, 1);
    state.ground_force_n = [0.0, 0.0, 800.0];
    state.delta_f_n = [0.0, 0.0, 88.75];
    state.foot_load_fraction = [0.5, 0.5];
    (state.foot_load_fraction_sigma, state.hand_load_fraction_sigma, state.reach_sigma_m) =
        (0.02, 0.125, 0.03);
    state.hand_load_fraction = [0.25, 0.75];
    state.load_hand_distance_m = 0.02;
    state.variance_max_m2 = 0.0015;
    state.predicted_cop_sigma_m = 0.006;
    state.nis = 1.5;
    state.prior_inflation = 1.0;
    state.motion_samples_used = 250;
    state.group_delay_ns = 100_000_000;
    state.cop_measured_sigma_m = [0.001, 0.002];
    state.delta_f_sigma_n = 3.5;
    state.lifted_mass_kg = 9.0;
    state.lifted_mass_sigma_kg = 0.25;
    state.sharing_source = 1;
    state.reach_m = 0.45;
    (state.l5s1_moment_nm, state.l5s1_moment_sigma_nm) = (120.0, 6.0);
    (state.l5s1_compression_n, state.l5s1_compression_sigma_n) = (2400.0, 480.0);
    (state.lifts, state.dose_damage, state.dose_probability) = (3, 0.0005, 0.125);
    state.worst_joint = 0;
    state.advice_direction = [-0.6, 0.8, 0.0];
    state.advice_gain_nm_per_cm = 0.75;
    state.torque_limit_nm = [107.0; 22];
    state.fatigue = [0.25; 22];
    state.torque_nm = [[1.0, -2.5, 0.0]; 22];
    state.torque_sigma_nm = [0.75; 22];
    state.joint_level[0] = 4;
    state
}

fn parsed(state: &State) -> Value {
    serde_json::from_str(&StateJson::new(state, 0.25).to_text().unwrap()).unwrap()
}

#[test]
fn a_withheld_state_is_exactly_this_text() {
    let mut state = monitoring();
    state.phase = Phase::Degraded as u32;
    state.valid = Validity::SUIT_STALE.and(Validity::FEET_OFF_PLATE).0;
    let text = StateJson::new(&state, 12.5).to_text().unwrap();
    let expected = r#"{"t":12.5,"cycle":7,"phase":"degraded","valid":["suit_stale","feet_off_plate"],"#
        .to_owned()
        + r#""static_pose":true,"converged":true,"poses_used":12,"stance":2,"motion_samples_used":250,"#
        + r#""group_delay_ns":100000000,"suit_age_ns":4000000,"ground_age_ns":900000,"#
        + r#""mass_kg":72.5,"body_source":"null_pose","foot_outline_source":"suit","#
        + r#""ground_force_n":[0.0,0.0,800.0],"vertical_force_n":800.0,"ground_devices":["plate"],"#
        + r#""variance_max_m2":0.0015,"predicted_cop_sigma_m":0.006,"nis":1.5,"prior_inflation":1.0,"#
        + r#""lifts":3,"dose_damage":0.0005,"dose_probability":0.125,"#
        + r#""fatigue":{"L5S1":0.25,"L4L3":0.25,"#;
    assert_eq!(&text[..expected.len()], expected);
    assert!(text.ends_with(r#""LeftBallFoot":0.25}}"#), "the fatigue is the last: {text}");
}

#[test]
fn a_whole_state_is_exactly_this_text_up_to_the_second_joint() {
    let text = StateJson::new(&monitoring(), 12.5).to_text().unwrap();
    let before_fatigue = r#"{"t":12.5,"cycle":7,"phase":"monitoring","valid":[],"static_pose":true,"#
        .to_owned()
        + r#""converged":true,"poses_used":12,"stance":2,"motion_samples_used":250,"#
        + r#""group_delay_ns":100000000,"suit_age_ns":4000000,"ground_age_ns":900000,"#
        + r#""mass_kg":72.5,"body_source":"null_pose","foot_outline_source":"suit","cop_measured":[0.0625,-0.01],"cop_measured_sigma":[0.001,0.002],"#
        + r#""cop_estimated":[0.03,-0.02],"#
        + r#""cop_sigma":[0.004,0.005],"com":[0.03,-0.02,0.98],"suit_com":[0.04,-0.02,0.97],"#
        + r#""acceleration_source":"positions","#
        + r#""ground_force_n":[0.0,0.0,800.0],"vertical_force_n":800.0,"ground_devices":["plate"],"#
        + r#""delta_f_n":[0.0,0.0,88.75],"delta_f_sigma_n":3.5,"#
        + r#""lifted_mass_kg":9.0,"lifted_mass_sigma_kg":0.25,"#
        + r#""foot_load_fraction":[0.5,0.5],"foot_load_fraction_sigma":0.02,"sharing_source":"measured","hand_load_fraction":[0.25,0.75],"hand_load_fraction_sigma":0.125,"load_hand_distance_m":0.02,"#
        + r#""reach_m":0.45,"reach_sigma_m":0.03,"#
        + r#""variance_max_m2":0.0015,"predicted_cop_sigma_m":0.006,"nis":1.5,"prior_inflation":1.0,"#
        + r#""l5s1_moment_nm":120.0,"l5s1_moment_sigma_nm":6.0,"l5s1_compression_n":2400.0,"#
        + r#""l5s1_compression_sigma_n":480.0,"lifts":3,"dose_damage":0.0005,"dose_probability":0.125,"#
        + r#""worst_joint":"L5S1","advice_direction":[-0.6,0.8,0.0],"advice_gain_nm_per_cm":0.75,"#
        + r#""fatigue":{"L5S1":0.25,"#;
    assert_eq!(&text[..before_fatigue.len()], before_fatigue);
    let joints = r#"},"joints":{"L5S1":{"torque_nm":[1.0,-2.5,0.0],"sigma_nm":0.75,"level":"above_max","#
        .to_owned()
        + r#""limit_nm":107.0,"fatigue":0.25},"#
        + r#""L4L3":{"torque_nm":[1.0,-2.5,0.0],"sigma_nm":0.75,"level":"none","limit_nm":107.0,"fatigue":0.25},"#;
    assert!(text.contains(&joints), "{text}");
}

#[test]
fn every_reason_alone_withholds_the_torques_and_names_itself() {
    for (reason, name) in Validity::NAMES {
        let mut state = monitoring();
        state.valid = reason.0;
        let json = parsed(&state);
        assert_eq!(json["valid"], serde_json::json!([name]));
        for key in ["joints", "worst_joint", "advice_direction", "advice_gain_nm_per_cm", "reach_m"] {
            assert!(json.get(key).is_none(), "{name} {key}");
        }
        for key in ["fatigue", "lifts", "dose_damage", "dose_probability"] {
            assert!(json.get(key).is_some(), "{name} {key}: sums are always published");
        }
        let back = json.get("l5s1_compression_n").is_some();
        assert_eq!(
            back,
            *reason == Validity::BELOW_LOAD_THRESHOLD,
            "{name}: the back carries the body alone"
        );
    }
}

#[test]
fn what_the_sensors_do_not_give_is_named_and_absent() {
    let mut state = monitoring();
    state.unavailable = Unavailable::SuitCom as u32 | Unavailable::Shear as u32;
    state.body_rejected = BodyRejection::ContradictsPoses as u32;
    let json = parsed(&state);
    assert_eq!(json["unavailable"], serde_json::json!(["suit_com", "shear"]));
    assert_eq!(json["valid"], serde_json::json!([]), "nothing is wrong");
    assert_eq!(json["body_rejected"], "contradicts_poses");
    assert_eq!(json["vertical_force_n"], 800.0);
    assert!(json.get("suit_com").is_none() && json.get("ground_force_n").is_none());
}

#[test]
fn the_distance_of_a_load_that_is_not_at_the_hands_is_published() {
    let mut state = monitoring();
    state.valid = Validity::LOAD_NOT_AT_HANDS.0;
    let json = parsed(&state);
    assert!(json.get("hand_load_fraction").is_none());
    assert_eq!(json["load_hand_distance_m"], 0.02);
}

#[test]
fn nothing_is_ever_null() {
    let mut state = monitoring();
    state.com_m[1] = f64::NAN;
    state.nis = f64::INFINITY;
    state.torque_nm[3][0] = f64::NAN;
    state.torque_sigma_nm[4] = f64::NAN;
    let text = StateJson::new(&state, 0.0).to_text().unwrap();
    assert!(!text.replace("null_pose", "").contains("null"), "{text}");
    let json = parsed(&state);
    assert!(json.get("com").is_none() && json["joints"].get("T9T8").is_none());
    assert!(json["joints"].get("T1C7").is_some_and(|joint| joint.get("sigma_nm").is_none()));
}

#[test]
fn a_pose_is_mentioned_only_when_asked_for() {
    let mut state = monitoring();
    assert!(parsed(&state).get("pose_mismatch_rad").is_none());
    state.suggested_pose = 3;
    state.pose_mismatch_rad = 0.5;
    let json = parsed(&state);
    assert_eq!((&json["suggested_pose"], &json["pose_mismatch_rad"]), (&3.into(), &0.5.into()));
}

#[test]
fn values_that_were_not_found_are_absent() {
    let mut state = monitoring();
    (state.suit_skew_s, state.advice_direction, state.worst_joint) = (0.004, [0.0; 3], u32::MAX);
    (state.cop_measured_sigma_m, state.delta_f_sigma_n) = ([0.0; 2], 0.0);
    let json = parsed(&state);
    for key in [
        "suit_skew_s",
        "suit_skew_sigma_s",
        "advice_direction",
        "advice_gain_nm_per_cm",
        "worst_joint",
        "cop_measured_sigma",
        "delta_f_sigma_n",
    ] {
        assert!(json.get(key).is_none(), "{key}");
    }
    state.suit_skew_sigma_s = 0.001;
    let json = parsed(&state);
    assert_eq!((&json["suit_skew_s"], &json["suit_skew_sigma_s"]), (&0.004.into(), &0.001.into()));
}

#[test]
fn the_schema_has_the_keys_of_the_json_in_their_order() {
    let schema = schema::state();
    let mut whole = monitoring();
    (whole.suggested_pose, whole.pose_mismatch_rad) = (3, 0.5);
    (whole.suit_skew_s, whole.suit_skew_sigma_s) = (0.004, 0.001);
    (whole.unavailable, whole.body_rejected) = (0, BodyRejection::Stale as u32);
    let text = StateJson::new(&whole, 1.5).to_text().unwrap();
    assert_eq!(misfits(&schema, &parsed(&whole)), [""; 0]);
    // `unavailable` is present exactly if a quantity is unavailable.
    let mut at = 0;
    for Key(name, ..) in KEYS.iter().filter(|Key(name, ..)| *name != "unavailable") {
        let found = text[at..].find(&format!("\"{name}\":"));
        at += found.unwrap_or_else(|| panic!("{name} does not stand after {}: {text}", &text[..at]));
    }
    whole.unavailable = u32::MAX;
    assert_eq!(misfits(&schema, &parsed(&whole)), [""; 0]);
}

#[test]
fn what_is_always_there_is_there_when_everything_is_withheld() {
    let mut nothing = State::zeroed();
    nothing.valid = Validity::NAMES.iter().fold(0, |bits, (reason, _)| bits | reason.0);
    nothing.ground_age_ns = u64::MAX;
    (nothing.suggested_pose, nothing.worst_joint) = (u32::MAX, u32::MAX);
    let json = parsed(&nothing);
    assert_eq!(misfits(&schema::state(), &json), [""; 0]);
    let added_up = ["dose_damage", "dose_probability"];
    for Key(name, _, presence, _) in KEYS.iter().filter(|Key(name, ..)| !added_up.contains(name)) {
        assert_eq!(json.get(name).is_some(), *presence == Presence::Always, "{name}");
    }
}

#[test]
fn the_schema_refuses_what_is_no_state() {
    let schema = schema::state();
    for (key, wrong) in [
        ("t", "x".into()),
        ("valid", serde_json::json!(["no_reason"])),
        ("cop_measured", [1.0].as_slice().into()),
    ] {
        let mut json = parsed(&monitoring());
        json[key] = wrong;
        assert_eq!(misfits(&schema, &json).len(), 1, "{key}");
    }
    let mut json = parsed(&monitoring());
    json["joints"]["L5S1"]["level"] = "purple".into();
    json["colour"] = 1.into();
    json.as_object_mut().unwrap().remove("cycle");
    assert_eq!(misfits(&schema, &json).len(), 3);
}
