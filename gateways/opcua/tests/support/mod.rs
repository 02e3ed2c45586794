//! Hand-made readings.

use std::time::Duration;

use bytemuck::Zeroable;
use equipoise_client::clock::now_ns;
use equipoise_client::{NoReading, Reading};
use equipoise_core::message::{State, Validity};
use equipoise_gateways::Latest;

/// A current state, 70 ms after its sample time, with a value in every field and these validity flags.
pub(crate) fn reading(valid: Validity) -> Reading {
    let now_ns = now_ns();
    let mut state = State {
        cycle: 4711,
        time_ns: now_ns - 2_000_000,
        suit_sample_time_ns: now_ns - 72_000_000,
        valid: valid.0,
        phase: 2,
        worst_joint: 0,
        lifts: 3,
        lifted_mass_kg: 4.1,
        lifted_mass_sigma_kg: 0.2,
        l5s1_moment_nm: 80.0,
        l5s1_moment_sigma_nm: 9.0,
        l5s1_compression_n: 2000.0,
        l5s1_compression_sigma_n: 300.0,
        dose_damage: 0.01,
        dose_probability: 0.1,
        ..State::zeroed()
    };
    for joint in 0..state.torque_nm.len() {
        state.torque_nm[joint] = [3.0, 4.0, 12.0];
        state.torque_sigma_nm[joint] = 1.5;
        state.torque_limit_nm[joint] = 60.0;
        state.joint_level[joint] = 1;
        state.fatigue[joint] = 0.25;
    }
    Reading {
        state,
        received_ns: now_ns,
        age_ns: 2_000_000,
        sample_age_ns: Some(72_000_000),
        missed: 0,
        restarted: false,
        daemon_life: 1,
        is_new: true,
    }
}

/// The daemon publishes nothing.
pub(crate) fn silence() -> Latest {
    Err(NoReading::Silent { silent: Duration::from_secs(1) })
}
