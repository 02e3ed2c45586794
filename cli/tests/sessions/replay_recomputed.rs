//! Recordings of a live loop, replayed from an empty memory with another configuration.

use bytemuck::Zeroable;
use equipoise_config::Config;
use equipoise_core::cycle::Tare;
use equipoise_core::cycle::memory::MEMORY_VERSION;
use equipoise_core::message::State;

use crate::replay_recorded_cycles::{CONFIG, CYCLES, live, live_with};

#[test]
fn the_tare_is_the_recorded_one() {
    let tare = Tare { force_n: [3.0, -2.0, 120.0], moment_nm: [4.0, 5.0, 0.0], ..Tare::zeroed() };
    let mut live = live_with(&tare, &[101], &[]);
    let readings = |states: &[State]| -> Vec<(u64, [f64; 2], [f64; 3])> {
        states.iter().map(|state| (state.cycle, state.cop_measured_m, state.ground_force_n)).collect()
    };
    // The live loop, too, began with an empty memory and this tare. The first cycle has no samples, the last is not in
    // the file.
    let expected = readings(&live.states[1..CYCLES as usize - 1]);
    let (summary, states) = live.replay_with(CONFIG);
    assert!(summary.is_complete(), "{summary}");
    assert_eq!(readings(&states), expected);
    assert!(states.iter().any(|state| (state.ground_force_n[2] - 586.0).abs() < 1e-9));

    live.format = MEMORY_VERSION + 1;
    let (summary, states) = live.replay_with(CONFIG);
    let text = summary.to_string();
    assert!(text.contains("another version") && text.contains("without its tare"), "{text}");
    assert!(!summary.is_complete());
    assert_ne!(readings(&states), expected);
}

#[test]
fn with_another_rate_the_phases_last_as_recorded() {
    let config = CONFIG.replace("[suit]", "[loop]\nrate_hz = 100\n[suit]");
    assert_eq!(Config::parse(&config, "test").unwrap().period_ns(), 10_000_000);
    let (summary, _) = live(&[101], &[]).replay_with(&config);
    assert_eq!(summary.phase_ns.iter().sum::<u64>(), 1_000_000 * summary.cycles);
}
