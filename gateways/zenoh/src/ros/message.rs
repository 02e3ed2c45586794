//! Encodes a state as `equipoise_msgs/msg/State`. The definition is in `clients/ros2/equipoise_msgs/msg`;
//! `tests/ros_message.rs` decodes the result by it.

use equipoise_client::Reading;
use equipoise_core::body::Joint;
use equipoise_core::message::state::Unavailable;
use equipoise_core::message::{State, Validity};
use equipoise_gateways::Latest;

use super::names::ros_name;
use crate::cdr::Cdr;
use crate::json::reason_name;

const NS_PER_S: u64 = 1_000_000_000;

/// Message of a tick: station, sequence number, wall-clock time, and the reading; with the worker's mass if
/// `with_body`.
pub fn state_message(
    station: &str,
    sequence: u64,
    now_unix_ns: u64,
    latest: &Latest,
    with_body: bool,
) -> Vec<u8> {
    let mut cdr = Cdr::default();
    let reading = latest.as_ref().ok();
    stamp(&mut cdr, now_unix_ns - reading.map_or(0, |reading| reading.age_ns.min(now_unix_ns)));
    cdr.string(&format!("equipoise/{}", ros_name(station)));
    cdr.string(station);
    cdr.u64(sequence);
    cdr.bool(reading.is_some());
    cdr.string(latest.as_ref().err().map_or("", reason_name));
    times(&mut cdr, reading);
    let state = reading.map(|reading| &reading.state);
    cdr.string(state.map_or("", State::phase_name));
    reasons(&mut cdr, state);
    let whole = |state: &&State| {
        all_finite([state.hand_load_fraction[0], state.hand_load_fraction[1], state.reach_m]).is_some()
    };
    let of_torques = state.and_then(|state| state.unless(Validity::INVALIDATES_TORQUES, state));
    cdr.optional(of_torques.filter(whole), overload);
    cdr.optional(state.and_then(back), Cdr::array);
    cdr.optional(state.and_then(load), Cdr::array);
    external_force(&mut cdr, state);
    centres_of_pressure(&mut cdr, state);
    let vertical = |state: &State| state.unless(Validity::INVALIDATES_GROUND_FORCE, state.ground_force_n[2]);
    cdr.optional(state.and_then(vertical).and_then(finite), Cdr::f64);
    let mass = |state: &State| state.unless(Validity::MASS_UNKNOWN, state.mass_kg);
    cdr.optional(state.filter(|_| with_body).and_then(mass).and_then(finite), Cdr::f64);
    fatigue(&mut cdr, state);
    cdr.finish()
}

fn stamp(cdr: &mut Cdr, unix_ns: u64) {
    cdr.i32(i32::try_from(unix_ns / NS_PER_S).unwrap_or(i32::MAX)); // ROS time overflows in 2038
    cdr.u32((unix_ns % NS_PER_S) as u32);
}

fn times(cdr: &mut Cdr, reading: Option<&Reading>) {
    cdr.optional(reading.map(|reading| reading.state.cycle), Cdr::u64);
    cdr.optional(reading.map(|reading| reading.age_ns), Cdr::u64);
    cdr.optional(reading.and_then(|reading| reading.sample_age_ns), Cdr::u64);
}

fn reasons(cdr: &mut Cdr, state: Option<&State>) {
    let raised: Vec<&str> = state.into_iter().flat_map(|state| state.validity().names()).collect();
    cdr.sequence(raised.into_iter(), Cdr::string);
    let missing =
        |state| Unavailable::NAMES.into_iter().filter(move |(what, _)| !State::provides(state, *what));
    let missing: Vec<&str> = state.into_iter().flat_map(missing).map(|(_, name)| name).collect();
    cdr.sequence(missing.into_iter(), Cdr::string);
}

fn overload(cdr: &mut Cdr, state: &State) {
    let joints: Vec<Joint> = Joint::ALL.into_iter().filter(|joint| torque(state, *joint).is_some()).collect();
    cdr.sequence(joints.into_iter(), |cdr, joint| {
        let at = joint.index();
        cdr.string(joint.name());
        cdr.array(state.torque_nm[at]);
        cdr.f64(state.torque_sigma_nm[at]);
        // A level number of a later version that exceeds u8 becomes 0 (none).
        cdr.u8(u8::try_from(state.joint_level[at]).unwrap_or(0));
        cdr.optional(positive(state.torque_limit_nm[at]), Cdr::f64);
    });
    cdr.string(Joint::ALL.get(state.worst_joint as usize).map_or("", |joint| joint.name()));
    cdr.array(state.hand_load_fraction);
    cdr.f64(state.reach_m);
    let [x, y, z] = state.advice_direction;
    let advised = state.advice_direction != [0.0; 3];
    let advice = all_finite([x, y, z, state.advice_gain_nm_per_cm]).filter(|_| advised);
    cdr.optional(advice, Cdr::array);
}

/// A joint's torque, if the torque and its sigma are finite.
fn torque(state: &State, joint: Joint) -> Option<[f64; 3]> {
    finite(state.torque_sigma_nm[joint.index()]).and_then(|_| all_finite(state.torque_nm[joint.index()]))
}

fn back(state: &State) -> Option<[f64; 4]> {
    let back = [
        state.l5s1_moment_nm,
        state.l5s1_moment_sigma_nm,
        state.l5s1_compression_n,
        state.l5s1_compression_sigma_n,
    ];
    state.unless(Validity::INVALIDATES_LOW_BACK, back).and_then(all_finite)
}

fn load(state: &State) -> Option<[f64; 2]> {
    let load = [state.lifted_mass_kg, state.lifted_mass_sigma_kg];
    state.unless(Validity::INVALIDATES_LIFTED_MASS, load).and_then(all_finite)
}

fn external_force(cdr: &mut Cdr, state: Option<&State>) {
    let force = |state: &State| {
        let force_n = state.unless(Validity::INVALIDATES_DELTA_F, state.delta_f_n).and_then(all_finite)?;
        Some((force_n, positive(state.delta_f_sigma_n)))
    };
    cdr.optional(state.and_then(force), |cdr, (force_n, sigma_n)| {
        cdr.array(force_n);
        cdr.optional(sigma_n, Cdr::f64);
    });
}

fn centres_of_pressure(cdr: &mut Cdr, state: Option<&State>) {
    let measured = |state: &State| {
        state.unless(Validity::INVALIDATES_COP_MEASURED, (state.cop_measured_m, state.cop_measured_sigma_m))
    };
    let estimated = |state: &State| {
        state.unless(Validity::INVALIDATES_COP_ESTIMATED, (state.cop_estimated_m, state.cop_sigma_m))
    };
    for centre in [state.and_then(measured), state.and_then(estimated)] {
        let centre = centre.filter(|(position_m, _)| all_finite(*position_m).is_some());
        cdr.optional(centre, |cdr, (position_m, sigma_m)| {
            cdr.array(position_m);
            let known = sigma_m.iter().all(|sigma_m| positive(*sigma_m).is_some());
            cdr.sequence(sigma_m.into_iter().take(if known { 2 } else { 0 }), Cdr::f64);
        });
    }
}

fn fatigue(cdr: &mut Cdr, state: Option<&State>) {
    let of = |state: &State, joint: Joint| Some((joint, finite(state.fatigue[joint.index()])?));
    let known: Vec<(Joint, f64)> = Joint::ALL.into_iter().filter_map(|joint| of(state?, joint)).collect();
    cdr.sequence(known.into_iter(), |cdr, (joint, fatigue)| {
        cdr.string(joint.name());
        cdr.f64(fatigue);
    });
}

// State values are never NaN; if one were, it would be omitted.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn all_finite<const N: usize>(values: [f64; N]) -> Option<[f64; N]> {
    values.iter().all(|value| value.is_finite()).then_some(values)
}

/// Sigmas and limits are zero where they are unavailable.
fn positive(value: f64) -> Option<f64> {
    finite(value).filter(|value| *value > 0.0)
}
