//! Pictures of a recording for viewers, also after its recorder was killed; and retention of files by free disk space.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::{Duration, Instant};

use equipoise_adapters::recording::{Entry, Recording};
use equipoise_core::message::State;
use equipoise_simulator::simulation::SimulationHandle;
use equipoise_view::foxglove::{Channel, scene, state_text};

use crate::common::{Station, describe_output, person};

fn station(more: &str) -> (SimulationHandle, Station, String) {
    let (simulation, text) = person();
    let text = text + more;
    let station = Station::start(&text);
    (simulation, station, text)
}

fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < Duration::from_secs(60), "{what}");
        // The conditions read whole files.
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// States of a recording by time, and its pictures: topic, time, text.
struct Contents {
    states: BTreeMap<u64, Box<State>>,
    pictures: Vec<(String, u64, String)>,
}

fn read(path: &Path) -> (Contents, bool) {
    let recording = Recording::open(path).unwrap();
    let mut contents = Contents { states: BTreeMap::new(), pictures: Vec::new() };
    for entry in recording.entries() {
        let entry = entry.unwrap();
        match entry.entry {
            Entry::State(state) => drop(contents.states.insert(entry.log_time_ns, state)),
            Entry::Other { topic, data, .. } => {
                contents.pictures.push((
                    topic.to_string(),
                    entry.log_time_ns,
                    String::from_utf8(data).unwrap(),
                ));
            }
            _ => {}
        }
    }
    (contents, recording.truncated())
}

/// Every picture is that of the state in the file at its time.
fn assert_pictures_are_of_their_states(contents: &Contents) {
    for (topic, time_ns, text) in &contents.pictures {
        let state = contents.states.get(time_ns).unwrap_or_else(|| panic!("no state at {time_ns}"));
        let expected = if topic == Channel::SCENE.topic {
            scene::of(state, *time_ns).to_text().unwrap()
        } else {
            assert_eq!(topic, Channel::STATE.topic);
            state_text(state).unwrap()
        };
        assert_eq!(*text, expected);
    }
}

fn bytes(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |facts| facts.len())
}

#[test]
fn a_killed_recorder_leaves_pictures_of_earlier_states() {
    let (_simulation, station, _) = station("");
    let with = station.file("with.mcap");
    let mut recorder = station.command("record").arg(&with).spawn().unwrap();
    let without = station.file("without.mcap");
    let mut plain = station.command("record");
    plain.arg(&without).args(["--pictures-hz", "0", "--for", "4"]);
    let mut plain = plain.spawn().unwrap();
    // In addition to the header some chunks, each of a second.
    // A file without its complete header cannot be opened yet.
    until("chunks with pictures", || Recording::open(&with).is_ok() && read(&with).0.pictures.len() >= 80);
    recorder.kill().unwrap();
    recorder.wait().unwrap();

    let (contents, truncated) = read(&with);
    assert!(truncated, "it had no time to end the file");
    assert_pictures_are_of_their_states(&contents);
    // On both channels one for each twentieth of a second that has a state; the end of the file may cut off the last.
    let slots: BTreeSet<u64> = contents.states.keys().map(|time_ns| time_ns / 50_000_000).collect();
    let missing = (2 * slots.len()).checked_sub(contents.pictures.len());
    assert!(
        missing.is_some_and(|missing| missing <= 2),
        "{} of {} slots",
        contents.pictures.len(),
        slots.len()
    );

    assert!(matches!(plain.wait().unwrap().code(), Some(0 | 3)));
    let (contents, truncated) = read(&without);
    assert!(!truncated && contents.pictures.is_empty() && !contents.states.is_empty());
}

/// A measurement, not a requirement: the size of pictures in a file.
#[test]
fn pictures_have_the_documented_size() {
    let (simulation, station, _) = station("");
    simulation.take_pose(3).unwrap();
    let recorders: Vec<(&str, PathBuf, Child)> = ["0", "20", "60"]
        .into_iter()
        .map(|rate| {
            let out = station.file(&format!("{rate}.mcap"));
            let mut command = station.command("record");
            let child = command.arg(&out).args(["--pictures-hz", rate, "--for", "6"]).spawn().unwrap();
            (rate, out, child)
        })
        .collect();
    let mut counts = Vec::new();
    for (rate, out, mut child) in recorders {
        assert!(matches!(child.wait().unwrap().code(), Some(0 | 3)));
        let (contents, _) = read(&out);
        let of = |topic: &str| {
            let all: Vec<usize> = contents
                .pictures
                .iter()
                .filter(|(of, ..)| of == topic)
                .map(|(.., text)| text.len())
                .collect();
            (all.len(), all.iter().sum::<usize>() / all.len().max(1))
        };
        let (scenes, states) = (of(Channel::SCENE.topic), of(Channel::STATE.topic));
        println!(
            "{rate} Hz: {} bytes in the file for {} states; {} scenes of {} bytes, {} states of {} bytes before compression",
            bytes(&out),
            contents.states.len(),
            scenes.0,
            scenes.1,
            states.0,
            states.1
        );
        assert_eq!(scenes.0, states.0);
        counts.push(scenes.0);
    }
    assert!(counts[0] == 0 && counts[1] > 0 && counts[2] > counts[1], "{counts:?}");
}

fn files(directory: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(directory).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    files.retain(|path| path.extension().is_some_and(|end| end == "mcap"));
    files.sort();
    files
}

#[test]
fn a_service_goes_from_file_to_file_and_removes_the_oldest() {
    let recording =
        "[recording]\ndirectory = \"kept\"\nfile_max_mib = 2\ntotal_max_mib = 5\nfree_min_mib = 1\n";
    let (_simulation, station, text) = station(recording);
    let folder = station.file("kept");
    std::fs::create_dir(&folder).unwrap();
    let others = folder.join("somebody's.mcap");
    std::fs::write(&others, vec![0; 3 << 20]).unwrap();
    let service = |name: &str, text: &str| {
        let config = station.file(name);
        std::fs::write(&config, text).unwrap();
        let mut command = station.command("record");
        command.arg("--config").arg(config).stderr(std::process::Stdio::piped()).spawn().unwrap()
    };
    let mut child = service("record.toml", &text);
    let mut first = None;
    until("a file that was removed", || {
        let files = files(&folder);
        first = first.take().or_else(|| files.iter().find(|path| **path != others).cloned());
        first.as_ref().is_some_and(|first| !first.exists())
    });
    let id = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(id, rustix::process::Signal::TERM).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(others.exists(), "it is a file of others");

    let own_files: Vec<PathBuf> = files(&folder).into_iter().filter(|path| *path != others).collect();
    assert!(own_files.len() >= 2, "{own_files:?}");
    let mut last = None;
    for path in &own_files {
        let (contents, truncated) = read(path);
        assert!(!truncated, "{}: each file is ended", path.display());
        // The newest may have been ended right after its begin.
        assert!(!contents.pictures.is_empty() || Some(path) == own_files.last(), "{}", path.display());
        let cycles: Vec<u64> = contents.states.values().map(|state| state.cycle).collect();
        // The next file continues where the previous one ended; on a busy machine states may be lost, never duplicated.
        let begins_later = cycles.first().is_none_or(|first| last.is_none_or(|last| *first > last));
        assert!(begins_later, "{}", path.display());
        last = cycles.last().copied().or(last);
    }

    // A disk that can never be free enough: the recorder reports it, ends, and leaves no partial file.
    let mut child = service("full.toml", &text.replace("free_min_mib = 1", "free_min_mib = 900000000"));
    let mut log = String::new();
    std::io::Read::read_to_string(child.stderr.as_mut().unwrap(), &mut log).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{log}");
    assert!(log.contains("recording.free_min_mib") && log.contains("the station goes on"), "{log}");
    assert_eq!(files(&folder), [others], "the oldest were removed first");
    let output = station.command("status").output().unwrap();
    assert!(output.status.success(), "{}", describe_output(&output));
}
