//! `subject export` copies all data of a subject that `subject delete` removes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::Station;

/// Contents of all files below folders, by path.
fn contents(folders: &[&Path]) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut all, mut left) =
        (BTreeMap::new(), folders.iter().map(|folder| folder.to_path_buf()).collect::<Vec<_>>());
    while let Some(folder) = left.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            match entry.path() {
                path if path.is_dir() => left.push(path),
                path => drop(all.insert(path.clone(), std::fs::read(path).expect("a file"))),
            }
        }
    }
    all
}

fn index(folder: &Path) -> serde_json::Value {
    let text = std::fs::read(folder.join("index.json")).expect("an index");
    serde_json::from_slice(&text).expect("JSON")
}

/// Further files of the subject, some incomplete: name in the state directory, and content.
const ADDED: [(&str, &str); 5] = [
    ("subjects/anon-7.toml.new", "cut off"),
    ("subjects/anon-7.lifts.csv", "1,2,3"),
    ("stations/bench.toml.new", "cut off too"),
    ("flight/bench-cycle-7.mcap", "a flight record"),
    ("flight/bench-cycle-9.mcap.new", "half of one"),
];

#[test]
fn everything_that_deletion_removes_is_in_the_export() {
    let station = Station::new();
    let person = station.person();
    let mut daemon = station.daemon(&station.configuration());
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    wait_for("a profile", || station.profile("anon-1").exists().then_some(()));
    station.copy_profile("anon-1", "anon-7", |_| {});
    station.copy_profile("anon-1", "anon-77", |_| {});
    station.run(&["subject", "load", "anon-7"]).assert_done();
    wait_for("the status", || {
        station.status().filter(|status| status["daemon"]["subject"] == "anon-7").map(drop)
    });
    let recordings = station.file("recordings");
    std::fs::create_dir_all(recordings.join("deep")).expect("a folder");
    let recording = recordings.join("deep/of-7.mcap").to_string_lossy().into_owned();
    let recorded = station.run(&["record", &recording, "--for", "1.5"]);
    assert!(matches!(recorded.code, Some(0 | 3)), "{}", recorded.stderr);
    std::fs::write(format!("{recording}.minisig"), "a signature").expect("a file");
    let live = station.file("live");
    station.run(&["subject", "export", "anon-7", "--out", &live.to_string_lossy()]).assert_done();
    assert_eq!(index(&live)["daemons"][0]["station"], "bench");
    // A dead daemon changes no file between export and deletion; its station's file still names the subject.
    let state = station.state_directory();
    let names_subject = |content: &Vec<u8>| String::from_utf8_lossy(content).contains("\"anon-7\"");
    wait_for("the station's file", || {
        contents(&[&state.join("stations")]).values().any(names_subject).then_some(())
    });
    daemon.kill();
    for (name, text) in ADDED {
        std::fs::create_dir_all(state.join(name).parent().expect("a folder")).expect("a folder");
        std::fs::write(state.join(name), text).expect("a file");
    }

    assert_deleted_files_are_exported(&station, &recordings, &recording);
}

/// Exports the subject, deletes it, and compares the files.
fn assert_deleted_files_are_exported(station: &Station, recordings: &Path, recording: &str) {
    let state = station.state_directory();
    let (out, folder) = (station.file("exported"), recordings.to_string_lossy().into_owned());
    let to = out.to_string_lossy().into_owned();
    let export = ["subject", "export", "anon-7", "--recordings", &folder, "--with-recordings", "--out", &to];
    let message = station.run(&export);
    assert!(message.assert_done().contains("name no subject and may be of another"), "{}", message.stdout);
    let before = contents(&[&state, recordings]);
    station.run(&["subject", "delete", "anon-7", "--recordings", &folder, "--with-recordings"]).assert_done();
    let after = contents(&[&state, recordings]);
    let exported: Vec<Vec<u8>> = contents(&[&out]).into_values().collect();
    let removed: Vec<&PathBuf> = before
        .iter()
        .filter(|(path, content)| after.get(*path) != Some(content))
        // The lock holds no data.
        .filter(|(path, _)| path.extension().is_none_or(|extension| extension != "lock"))
        .map(|(path, _)| path)
        .collect();
    for path in &removed {
        assert!(exported.contains(&before[*path]), "{} is deleted but not exported", path.display());
    }
    let names =
        ADDED.map(|(name, _)| name).into_iter().chain(["subjects/anon-7.toml", "stations/bench.toml"]);
    let signature = PathBuf::from(format!("{recording}.minisig"));
    for path in names.map(|name| state.join(name)).chain([PathBuf::from(recording), signature]) {
        assert!(removed.contains(&&path), "{} is not deleted: {removed:?}", path.display());
    }
    let files = index(&out)["files"].as_array().expect("a list").len();
    assert_eq!((files, exported.len()), (removed.len(), removed.len() + 1), "nothing else but the index");
    assert!(station.profile("anon-77").exists());
    let other = before[&station.profile("anon-77")].clone();
    assert!(!exported.contains(&other), "no other subject's profile");
}

#[test]
fn an_export_reports_what_it_leaves_out_and_replaces_nothing() {
    let station = Station::new();
    let profile = station.profile("anon-5");
    std::fs::create_dir_all(profile.parent().expect("a folder")).expect("a folder");
    std::fs::write(&profile, "a profile").expect("a file");
    let archive = station.file("anon-5.tar").to_string_lossy().into_owned();
    let message = station.run(&["subject", "export", "anon-5", "--out", &archive]);
    assert!(message.assert_done().contains("NOT looked for: recordings"), "{}", message.stdout);
    station.run(&["subject", "export", "anon-5", "--out", &archive]).assert_failed(1, &["exists already"]);
    let none = station.file("none.tar").to_string_lossy().into_owned();
    station
        .run(&["subject", "export", "anon-6", "--out", &none])
        .assert_failed(1, &["there is no profile anon-6"]);
    assert!(!Path::new(&none).exists());
    station.run(&["subject", "export", "../x", "--out", &none]).assert_failed(1, &["letters, digits"]);
}
