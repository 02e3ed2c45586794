//! A recording of a live daemon by the real program is replayed identically, state by state, byte by byte.

use std::time::Duration;

use equipoise_recording::replay::Replay;
use equipoise_recording::replay::input::Input;

use crate::common::{Station, describe_output, equipoise, person, remove_shared_memory};
use crate::process::{Process, wait_for};
use rustix::process::Signal;

const MODEL: &str = r#"version = 1
[[effect]]
name = "plate_offset"
span_s = [0.0, 1.0]
open_ended = true
log_odds = 9.0
parameters = { dx_m = { value = 0.003, sigma = 0.001, unit = "m" } }
"#;

/// Waits until the loop has run for more than half a second of cycles with what is in force now.
fn wait_for_cycles(station: &Station) {
    let cycle = || {
        let output = station.command("status").arg("--json").output().unwrap();
        let status = serde_json::from_slice::<serde_json::Value>(&output.stdout).ok()?;
        status["state"]["cycle"].as_u64()
    };
    let first = wait_for("a state", cycle);
    wait_for("cycles of the loop", || cycle().filter(|last| *last > first + 600));
}

#[test]
fn a_live_recording_and_its_replay_give_the_same_states() {
    let (simulation, text) = person();
    let station = Station::start(&text);
    std::fs::write(station.file("model.toml"), MODEL).unwrap();

    let out = station.file("live.mcap");
    let mut command = station.command("record");
    command.arg(&out).args(["--for", "120"]);
    let mut recorder = Process::start(command, station.file("record.out"), station.file("record.err"));
    wait_for("the recorder", || recorder.stderr().contains("recording station").then_some(()));
    let ask = |what: &str| {
        let output = station.command("identify").arg(what).output().unwrap();
        assert!(output.status.success(), "{}", describe_output(&output));
    };
    simulation.take_pose(3).unwrap();
    std::thread::sleep(Duration::from_millis(2500));
    ask("stop");
    std::thread::sleep(Duration::from_millis(800));
    station.reload(&(text.clone() + "[overload]\nmotion_window_ms = 50.0\n[model]\nfile = \"model.toml\"\n"));
    simulation.take_pose(7).unwrap();
    ask("start");
    wait_for_cycles(&station);
    station.reload(&(text + "[overload]\nmotion_window_ms = 90.0\n[static_pose]\nnew_pose_deg = 8.0\n"));
    wait_for_cycles(&station);
    let recorded = recorder.stop(Signal::INT);
    // An overloaded machine may lose messages; the exit code reports it, and all others must be in the file.
    assert!(matches!(recorded, Some(0 | 3)), "{recorded:?} {}", recorder.stderr());

    let again = station.command("record").arg(&out).args(["--for", "1"]).output().unwrap();
    assert_eq!(again.status.code(), Some(1), "{}", describe_output(&again));
    assert!(describe_output(&again).contains("choose a new name"), "{}", describe_output(&again));

    let input = Input::open(&out).unwrap();
    let chosen = input.configuration(None).unwrap();
    let replay = Replay { input: &input, config: &chosen.config, as_recorded: true, residual_s: None };
    let summary = replay.run(None).unwrap();
    let fidelity = summary.fidelity.clone().unwrap();
    println!("{summary}");
    assert_eq!((fidelity.states_differing, fidelity.memories_differing), (0, 0), "{summary}");
    assert!(fidelity.states_compared > 500, "{summary}");
    // One checkpoint for each of the two commands.
    assert!(fidelity.memories_compared + fidelity.resumed >= 2, "{summary}");
    if recorded == Some(0) {
        assert_eq!(fidelity.reloads, 2, "{summary}");
        assert!(summary.is_complete(), "{summary}");
        let lines = station.file("live.jsonl");
        let output = equipoise().arg("replay").arg(&out).arg("--out").arg(&lines).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", describe_output(&output));
        let lines = std::fs::read_to_string(lines).unwrap();
        assert_eq!(lines.lines().count() as u64, fidelity.cycles);
    }
}

#[test]
fn without_a_daemon_there_is_nothing_to_record() {
    let directory = tempfile::Builder::new().prefix("eq").tempdir_in("/tmp").unwrap();
    let out = directory.path().join("out.mcap");
    let output = equipoise()
        .env("EQUIPOISE_BUS_ROOT", directory.path().join("bus"))
        .args(["record", "--for", "1"])
        .arg(&out)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", describe_output(&output));
    assert!(
        describe_output(&output).contains("no daemon runs on station station-1"),
        "{}",
        describe_output(&output)
    );
    assert!(!out.exists());
    remove_shared_memory(&directory.path().join("bus"));
}
