//! `subject delete` really deletes.

use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::process::Signal;

use crate::eyes::Eyes;
use crate::process::wait_for;
use crate::station::Station;

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

/// Files whose name or content has it.
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
fn a_deleted_subject_is_gone_from_files_and_from_a_running_daemon() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut eyes = Eyes::open(&station);
    eyes.until_poses(&person, 1);
    let profile = station.profile("anon-1");
    wait_for("a profile", || profile.exists().then_some(()));
    let text = std::fs::read_to_string(&profile).expect("a profile");
    std::fs::write(station.profile("anon-77"), text.replace("anon-1", "anon-77")).expect("a second profile");
    std::fs::write(station.state_directory().join("subjects/anon-77.toml.new"), "cut off")
        .expect("a leftover");
    let state = station.state_directory();
    station.run(&["subject", "load", "anon-77"]).done();
    wait_for("the station's file", || mentions(&state.join("stations"), "anon-77").pop());
    let recordings = station.file("recordings");
    std::fs::create_dir(&recordings).expect("a folder");
    let recording = recordings.join("of-77.mcap").to_string_lossy().into_owned();
    wait_for("the status", || {
        station.status().filter(|status| status["daemon"]["subject"] == "anon-77").map(drop)
    });
    assert!(matches!(station.run(&["record", &recording, "--for", "1.5"]).code, Some(0 | 3)));

    // Listed, not deleted, unless asked for.
    let folder = recordings.to_string_lossy().into_owned();
    let said = station.run(&["subject", "delete", "anon-77", "--recordings", &folder]);
    let said = said.done();
    for part in ["was in use", "anon-77.toml is deleted", "NOT deleted: ", "of-77.mcap", "NOT looked for: "] {
        assert!(said.contains(part), "{part:?} is not in {said}");
    }
    assert!(Path::new(&recording).exists());
    let look = || assert_eq!(mentions(&state, "anon-77"), [] as [PathBuf; 0]);
    look();
    // The worker still moves and is learnt, under no name.
    let before = eyes.look().poses_used;
    eyes.until("the unknown worker", |eyes| eyes.state.poses_used == 0 || before == 0);
    eyes.until_poses(&person, 1);
    eyes.during(Duration::from_secs(3), |_| look());
    assert!(daemon.is_running());
    station.run(&["subject", "save"]).failed_with(1, &["deleted", "load another"]);

    let said = station.run(&["subject", "delete", "anon-77", "--recordings", &folder, "--with-recordings"]);
    assert!(said.done().contains("of-77.mcap is deleted") && !Path::new(&recording).exists());
    station.run(&["subject", "delete", "anon-77"]).failed_with(1, &["there is no profile anon-77"]);

    // The configured one: the daemon says that its configuration names it.
    station.run(&["subject", "load", "anon-1"]).done();
    assert!(station.run(&["subject", "delete", "anon-1"]).done().contains("change subject.id"));
    eyes.during(Duration::from_secs(3), |_| assert_eq!(mentions(&state, "anon-1"), [] as [PathBuf; 0]));
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
    assert_eq!(mentions(&state, "anon-1"), [] as [PathBuf; 0], "nor at its end");
}

#[test]
fn a_daemon_that_does_not_answer_keeps_a_subject_from_being_deleted() {
    let station = Station::new();
    let mut daemon = station.daemon(&station.configuration());
    let profile = station.profile("anon-5");
    std::fs::create_dir_all(profile.parent().expect("a folder")).expect("a folder");
    std::fs::write(&profile, "x").expect("a file");
    daemon.send(Signal::STOP);
    station.run(&["subject", "delete", "anon-5"]).failed_with(1, &["nothing is deleted", "stop it first"]);
    assert!(profile.exists());
    daemon.kill();
    // Nor does a dead one's status hold anybody up.
    station.run(&["subject", "delete", "anon-5"]).done();
    assert!(!profile.exists());
}
