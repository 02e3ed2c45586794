//! `subject delete` deletes all data of a subject.

use std::path::{Path, PathBuf};
use std::time::Duration;

use equipoise_daemon::stored_file::sealed;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::{NAME, Station};

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.path().is_dir() {
            all.extend(files(&entry.path()));
        } else {
            all.push(entry.path());
        }
    }
    all
}

/// Files whose name or content contains the id.
fn mentions(folder: &Path, id: &str) -> Vec<PathBuf> {
    let mut all = files(folder);
    all.retain(|path| {
        let content = std::fs::read(path).unwrap_or_default();
        let inside = content.windows(id.len()).any(|window| window == id.as_bytes());
        inside || path.to_string_lossy().contains(id)
    });
    all
}

#[test]
fn a_deleted_subject_is_removed_from_files_and_a_running_daemon() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    let profile = station.profile("anon-1");
    wait_for("a profile", || profile.exists().then_some(()));
    station.copy_profile("anon-1", "anon-77", |_| {});
    std::fs::write(station.state_directory().join("subjects/anon-77.toml.new"), "cut off")
        .expect("a leftover");
    let state = station.state_directory();
    station.run(&["subject", "load", "anon-77"]).assert_done();
    wait_for("the station's file", || mentions(&state.join("stations"), "anon-77").pop());
    let recordings = station.file("recordings");
    std::fs::create_dir(&recordings).expect("a folder");
    let recording = recordings.join("of-77.mcap").to_string_lossy().into_owned();
    wait_for("the status", || {
        station.status().filter(|status| status["daemon"]["subject"] == "anon-77").map(drop)
    });
    assert!(matches!(station.run(&["record", &recording, "--for", "1.5"]).code, Some(0 | 3)));
    std::fs::write(recordings.join("of-77.mcap.gz"), "packed").expect("a file");

    // Listed, and deleted only on request.
    let folder = recordings.to_string_lossy().into_owned();
    let message = station.run(&["subject", "delete", "anon-77", "--recordings", &folder]);
    let message = message.assert_done();
    for part in [
        "was in use",
        "anon-77.toml is deleted",
        "NOT deleted: ",
        "of-77.mcap",
        "of-77.mcap.gz is no",
        "NOT looked for: ",
    ] {
        assert!(message.contains(part), "{part:?} is not in {message}");
    }
    assert!(Path::new(&recording).exists());
    let look = || assert_eq!(mentions(&state, "anon-77"), [] as [PathBuf; 0]);
    look();
    // The worker still moves and is identified, without a name: the loop reset the worker before the deletion was done.
    wait_for("the unknown worker", || {
        station.status().filter(|status| status["daemon"]["subject"] == "").map(drop)
    });
    let before = *monitor.update();
    monitor.until("states of the unknown worker", |monitor| monitor.state.cycle > before.cycle);
    monitor.until_poses(&person, 1);
    monitor.during(Duration::from_secs(3), |_| look());
    assert!(daemon.is_running());
    station.run(&["subject", "save"]).assert_failed(1, &["deleted", "load another"]);

    let message =
        station.run(&["subject", "delete", "anon-77", "--recordings", &folder, "--with-recordings"]);
    assert!(message.assert_done().contains("of-77.mcap is deleted") && !Path::new(&recording).exists());
    station.run(&["subject", "delete", "anon-77"]).assert_failed(1, &["there is no profile anon-77"]);

    // The configured one: the daemon reports that its configuration names it.
    station.run(&["subject", "load", "anon-1"]).assert_done();
    assert!(station.run(&["subject", "delete", "anon-1"]).assert_done().contains("change subject.id"));
    monitor.during(Duration::from_secs(3), |_| assert_eq!(mentions(&state, "anon-1"), [] as [PathBuf; 0]));
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert_eq!(mentions(&state, "anon-1"), [] as [PathBuf; 0], "nor at its end");
}

#[test]
fn a_daemon_without_reply_prevents_the_deletion() {
    let station = Station::new();
    let mut daemon = station.daemon(&station.configuration());
    let profile = station.profile("anon-5");
    std::fs::create_dir_all(profile.parent().expect("a folder")).expect("a folder");
    std::fs::write(&profile, "x").expect("a file");
    daemon.send(Signal::STOP);
    station.run(&["subject", "delete", "anon-5"]).assert_failed(1, &["nothing is deleted", "stop it first"]);
    assert!(profile.exists());
    daemon.kill();
    // The status of a dead daemon does not delay the command either.
    station.run(&["subject", "delete", "anon-5"]).assert_done();
    assert!(!profile.exists());
}

/// Only the service manager sets the daemon's state directory; the user of `subject` or `doctor` has another
/// environment.
#[test]
fn a_subject_is_found_in_the_daemon_s_state_directory() {
    let station = Station::new();
    let person = station.person();
    let (service, own) = (station.file("service"), station.state_directory());
    let mut daemon = station.daemon_with_state_in(&service);
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    let profile = service.join("subjects/anon-1.toml");
    wait_for("a profile", || profile.exists().then_some(()));
    assert!(station.run(&["subject", "list"]).assert_done().contains("anon-1"));
    let output = station.run(&["doctor", "--json"]).stdout;
    assert!(
        output.contains(&*service.to_string_lossy()) && !output.contains(&*own.to_string_lossy()),
        "{output}"
    );
    wait_for("the status", || {
        station.status().filter(|status| status["daemon"]["subject"] == "anon-1").map(drop)
    });
    let recording = station.file("live.mcap");
    let out = recording.to_string_lossy().into_owned();
    assert!(matches!(station.run(&["record", &out, "--for", "1"]).code, Some(0 | 3)));
    let recorded = equipoise_adapters::recording::Recording::open(&recording).expect("a recording");
    assert!(recorded.header().subject_toml.contains("anon-1"), "the profile of the daemon is in it");

    // Data in the environment's directory are deleted as well, and flight records next to data of the subject.
    std::fs::create_dir_all(own.join("flight")).expect("a folder");
    std::fs::create_dir_all(service.join("flight")).expect("a folder");
    std::fs::write(own.join("flight/other-cycle-7.mcap"), "x").expect("a record");
    std::fs::write(service.join("flight/bench-cycle-7.mcap"), "x").expect("a record");
    // The daemon writes only the file in its own state directory, so the deletion clears this one.
    let former = own.join("stations").join(format!("{NAME}.toml"));
    std::fs::create_dir_all(own.join("stations")).expect("a folder");
    let text = sealed(format!(
        "format = 4\nstation = \"{NAME}\"\nsaved_unix_s = 1\n[subject]\nin_use = \"anon-1\"\nconfigured = \"x\"\n"
    ));
    std::fs::write(&former, text).expect("a file");
    let message = station.run(&["subject", "delete", "anon-1"]);
    assert!(
        message.assert_done().contains("bench-cycle-7.mcap is deleted: flight records name no subject"),
        "{}",
        message.stdout
    );
    assert!(!profile.exists() && !service.join("flight/bench-cycle-7.mcap").exists());
    assert!(former.exists());
    assert_eq!(mentions(&own, "anon-1"), [] as [PathBuf; 0]);
    assert_eq!(mentions(&service.join("subjects"), "anon-1"), [] as [PathBuf; 0]);
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn a_deletion_fails_without_files_or_if_a_daemon_is_unreachable() {
    let station = Station::new();
    let mut daemon = station.daemon(&station.configuration());
    // No suit streams: the configured subject is in use and was never saved.
    let message = station.run(&["subject", "delete", "anon-1"]);
    message.assert_failed(1, &["had anon-1 in use", "there was no profile", "somewhere else"]);
    let profile = station.profile("anon-5");
    std::fs::create_dir_all(profile.parent().expect("a folder")).expect("a folder");
    std::fs::write(&profile, "x").expect("a file");
    let other = station.root().join("equipoise-other.json");
    std::fs::write(&other, "{\"format\": 99}").expect("a status of another version");
    let message = station.run(&["subject", "delete", "anon-5"]);
    message.assert_failed(1, &["nothing is deleted", "equipoise-other.json"]);
    assert!(profile.exists());
    std::fs::remove_file(other).expect("the file");
    station.run(&["subject", "delete", "anon-5"]).assert_done();
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}

#[test]
fn without_a_state_directory_nothing_is_stored() {
    let station = Station::new();
    let nothing = std::ffi::OsStr::new("");
    let environment = [("STATE_DIRECTORY", nothing), ("XDG_STATE_HOME", nothing), ("HOME", nothing)];
    let configuration = station.write("nowhere.toml", &station.configuration());
    let configuration = configuration.to_string_lossy().into_owned();
    for arguments in
        [&["run", "--config", &configuration][..], &["subject", "list"], &["subject", "delete", "a"]]
    {
        let mut process = station.spawn_with(arguments, &environment);
        assert_eq!(process.wait().code(), Some(1), "{arguments:?}");
        assert!(process.stderr().contains("set STATE_DIRECTORY"), "{arguments:?}: {}", process.stderr());
    }
}
