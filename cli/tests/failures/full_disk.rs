//! A full disk: `EQUIPOISE_SMALL_DISK` is a folder on a small separate file system. `.ci/run survive` makes one.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use equipoise_core::message::Incident;
use equipoise_daemon::profile::Profile;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::Station;

/// Writes until the disk is full.
fn fill(disk: &Path) -> PathBuf {
    let path = disk.join("filler");
    let mut file = std::fs::File::create(&path).expect("a file");
    let mut size = 1 << 16;
    while size > 0 {
        if file.write_all(&vec![0x5a; size]).is_err() {
            size /= 2;
        }
    }
    path
}

#[test]
fn a_full_disk_stops_nothing_and_the_profile_is_saved_when_space_is_free() {
    let Some(disk) = std::env::var_os("EQUIPOISE_SMALL_DISK").map(PathBuf::from) else {
        println!("skipped: EQUIPOISE_SMALL_DISK names no small file system; .ci/run survive makes one");
        return;
    };
    let station = Station::new();
    let person = station.person();
    let state = disk.join("state");
    let mut daemon = station.daemon_with_state_in(&state);
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    let path = state.join("subjects").join("anon-1.toml");
    let saved =
        || Profile::read(&path).expect("a profile that is whole").map_or(0, |profile| profile.poses_used);
    wait_for("the first pose to be saved", || (saved() >= 1).then_some(()));
    assert!(!monitor.is_active(Incident::NotSaved));

    // A recorder on the same disk; its termination must not affect the daemon.
    let recording = disk.join("shift.mcap").to_string_lossy().into_owned();
    let mut recorder = station.spawn(&["record", &recording, "--for", "600"]);
    wait_for("the recorder", || recorder.stderr().contains("recording station").then_some(()));
    let filler = fill(&disk);
    assert_eq!(recorder.wait().code(), Some(1), "{}", recorder.stderr());
    let message = recorder.stderr();
    assert!(message.contains("shift.mcap") && message.contains("stays readable"), "{message}");
    std::fs::remove_file(&recording).expect("the recording");
    std::fs::remove_file(&filler).expect("the filler");
    let filler = fill(&disk);

    let before = saved();
    monitor.until("an incident", |monitor| monitor.is_active(Incident::NotSaved));
    let had = monitor.state.poses_used;
    monitor.until_poses(&person, had + 1);
    let poses = u64::from(monitor.state.poses_used);
    // Identification has ended from here on: only the pending data remain to be written.
    station.run(&["identify", "stop"]).assert_done();
    monitor.until("the end of the identification", |monitor| monitor.state.phase_name() == "monitoring");
    monitor.during(Duration::from_secs(2), |_| {});
    let cycle = monitor.state.cycle;
    monitor.until("more cycles", |monitor| monitor.state.cycle > cycle + 200);
    assert!(daemon.is_running() && monitor.is_active(Incident::NotSaved));
    assert!(saved() >= before && saved() < poses, "the file before is still there");
    assert!(daemon.stderr().contains("not_saved"), "{}", daemon.stderr());

    std::fs::remove_file(filler).expect("the filler");
    wait_for("the poses taken meanwhile", || (saved() >= poses).then_some(()));
    monitor.until("the end of the incident", |monitor| !monitor.is_active(Incident::NotSaved));
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}
