//! Recordings of a live loop, replayed from an empty memory with another configuration.

use bytemuck::Zeroable;
use equipoise_config::Config;
use equipoise_core::cycle::Tare;
use equipoise_core::cycle::memory::MEMORY_VERSION;
use equipoise_core::message::{CommandKind, State};

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
fn another_worker_begins_without_the_model_of_the_one_before() {
    let configured = format!("{CONFIG}mass_kg = 70.0\n");
    // Loaded at cycle 800 or with the daemon restarted there, and attached later or earlier.
    for (command, restarts, attached) in
        [(Some(CommandKind::SubjectLoad), false, 1300), (None, true, 1300), (None, true, 799)]
    {
        let commands: Vec<(u64, CommandKind)> = command.map(|command| (800, command)).into_iter().collect();
        let mut live = live(&[101], &commands);
        for record in live.cycles.iter_mut().filter(|record| restarts && record.cycle >= 800) {
            record.cycle -= 799;
        }
        for (id, is_other) in [("anon-1", false), ("anon-2", true)] {
            live.subjects = vec![(attached, id)];
            let (summary, states) = live.replay_with(&configured);
            // The first state is that of cycle 2.
            let is_configured = [797, 798, 1400].map(|index| states[index].mass_kg == 70.0);
            let has_body = [797, 798].map(|index| states[index].com_m[2] > 0.5);
            let text = summary.to_string();
            assert_eq!(is_configured, [true, !is_other, !is_other], "{text}");
            assert_eq!(has_body, [true, !is_other], "{text}");
            assert_eq!(text.contains("another worker from cycle"), is_other, "{text}");
            assert_eq!(summary.is_complete(), !is_other, "{text}");
        }
        // For a configuration of the later worker its mass is known.
        let (_, states) = live.replay_with(&configured.replace("anon-1", "anon-2"));
        assert_eq!(states[1400].mass_kg, 70.0);
    }
}

#[test]
fn with_another_rate_the_phases_last_as_recorded() {
    let config = CONFIG.replace("[suit]", "[loop]\nrate_hz = 100\n[suit]");
    assert_eq!(Config::parse(&config, "test").unwrap().period_ns(), 10_000_000);
    let (summary, _) = live(&[101], &[]).replay_with(&config);
    assert_eq!(summary.phase_ns.iter().sum::<u64>(), 1_000_000 * summary.cycles);
}
