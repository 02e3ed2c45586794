//! Permissions of the files that the program writes, and the names in them.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use equipoise_adapters::recording::Recording;
use rustix::process::Signal;

use crate::monitor::Monitor;
use crate::process::wait_for;
use crate::station::Station;

fn below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            below(&path, found);
        } else {
            found.push(path);
        }
    }
}

#[test]
fn files_are_for_owner_and_group_and_recordings_contain_no_paths_or_names() {
    let station = Station::new();
    let person = station.person();
    let out = station.file("grete-mustermann");
    std::fs::create_dir(&out).expect("a folder");
    let text = station.configuration();
    let (hlog, model) = (out.join("path.hlog"), out.join("model.toml"));
    std::fs::write(&model, "version = 1\n").expect("a model");
    let more = format!("[latency]\nhlog = {hlog:?}\n[model]\nfile = {model:?}\n");
    station.write("open.toml", &(text + &more));

    // With this umask only the program's own modes restrict access.
    let before = rustix::process::umask(rustix::fs::Mode::empty());
    let name = |name: &str| out.join(name).to_string_lossy().into_owned();
    let config = station.file("open.toml").to_string_lossy().into_owned();
    let mut daemon = station.daemon_of("open.toml", &[("USER", "grete".as_ref())]);
    let mut monitor = Monitor::open(&station);
    monitor.until_poses(&person, 1);
    wait_for("a profile", || station.profile("anon-1").exists().then_some(()));
    assert!(matches!(station.run(&["record", &name("a.mcap"), "--for", "2"]).code, Some(0 | 3)));
    assert!(matches!(station.run(&["replay", &name("a.mcap"), "--out", &name("a.csv")]).code, Some(0 | 3)));
    assert!(matches!(station.run(&["replay", &name("a.mcap"), "--out", &name("a.jsonl")]).code, Some(0 | 3)));
    let latency = station.run(&["latency", "--for", "3", "--hlog", &name("b.hlog")]);
    assert!(matches!(latency.code, Some(0 | 3)), "{}", latency.stderr);
    // Its findings are irrelevant here.
    station.run(&["reconcile", &name("a.mcap"), "--config", &config, "--out", &name("report")]);
    rustix::process::umask(before);
    let mut written = Vec::new();
    below(&station.state_directory(), &mut written);
    written.extend(["a.mcap", "a.csv", "a.jsonl", "b.hlog", "path.hlog"].map(|name| out.join(name)));
    below(&out.join("report"), &mut written);
    assert!(written.len() >= 7, "{written:?}");
    for path in &written {
        let mode = std::fs::metadata(path).expect("a file that was written").permissions().mode() & 0o777;
        assert_eq!(mode & !0o640, 0, "{}: {mode:o}", path.display());
    }
    for folder in [station.state_directory().join("subjects"), station.state_directory().join("stations")] {
        let mode = std::fs::metadata(&folder).expect("a folder").permissions().mode() & 0o777;
        assert_eq!(mode & 0o007, 0, "{}: {mode:o}", folder.display());
    }

    let recording = Recording::open(out.join("a.mcap")).expect("a recording");
    let header = recording.header();
    assert!(header.config_toml.contains("path.hlog") && header.config_toml.contains("model.toml"));
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let mut terms =
        vec!["grete".to_owned(), station.file("").to_string_lossy().into_owned(), "/home".to_owned()];
    terms.extend(["HOME", "HOSTNAME"].iter().filter_map(|name| std::env::var(name).ok()));
    terms.push(host.trim().to_owned());
    // Short words occur in any file; "localhost" is not personal.
    terms.retain(|term| term.len() > 4 && term != "localhost");
    let texts =
        [&header.config_toml, &header.subject_toml, &header.model_toml].map(|text| text.as_bytes().to_vec());
    let mut bytes = std::fs::read(out.join("a.mcap")).expect("a recording");
    bytes.extend(texts.concat());
    for term in terms {
        let found = bytes.windows(term.len()).any(|window| window == term.as_bytes());
        assert!(!found, "the recording names {term:?}");
    }
    assert_eq!(daemon.stop(Signal::TERM), Some(0));
}
