//! A recorder as a service: its reaction when its file is deleted, its daemon is replaced, or its bus is.

use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use equipoise_adapters::recording::{Entry, Recording};
use equipoise_simulator::simulation::SimulationHandle;

use crate::common::{Station, describe_output, person};
use rustix::process::{Pid, Signal, kill_process};

fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < Duration::from_secs(60), "{what}");
        // The conditions read whole files.
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// A station with a recorder as a service. Dropping it ends the recorder.
struct Recorded {
    _simulation: SimulationHandle,
    station: Station,
    config: String,
    service: Child,
    folder: PathBuf,
}

impl Recorded {
    fn start() -> Recorded {
        let (simulation, config) = person();
        let config = config.replace("[loop]", "[loop]\nrate_hz = 200")
            + "save_profile = false\n[recording]\ndirectory = \"kept\"\nfree_min_mib = 1\n";
        let station = Station::start(&config);
        std::fs::write(station.file("record.toml"), &config).unwrap();
        let mut command = station.command("record");
        let service = command.arg("--config").arg(station.file("record.toml")).stderr(Stdio::piped());
        let service = service.spawn().unwrap();
        let folder = station.file("kept");
        let recorded = Recorded { _simulation: simulation, station, config, service, folder };
        until("the first file", || recorded.files().iter().any(|path| states(path) > 0));
        recorded
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = std::fs::read_dir(&self.folder)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path())
            .collect();
        files.sort();
        files
    }

    /// The next file, once it contains states.
    fn next_after(&self, path: &Path) -> PathBuf {
        let next = || self.files().into_iter().find(|found| found.as_path() > path && states(found) > 0);
        until("the next file", || next().is_some());
        next().unwrap()
    }

    fn end(mut self) {
        kill_process(Pid::from_child(&self.service), Signal::TERM).unwrap();
        assert_eq!(self.service.wait().unwrap().code(), Some(0));
    }
}

impl Drop for Recorded {
    fn drop(&mut self) {
        let _ = self.service.kill();
        let _ = self.service.wait();
    }
}

/// States in the readable part of a file; 0 if it does not exist.
fn states(path: &Path) -> usize {
    let Ok(recording) = Recording::open(path) else { return 0 };
    let states = recording.entries().map_while(Result::ok);
    states.filter(|timed| matches!(timed.entry, Entry::State(_))).count()
}

#[test]
fn a_file_deleted_in_progress_is_closed_and_the_next_one_starts() {
    let recorded = Recorded::start();
    let [first] = &recorded.files()[..] else { panic!("{:?}", recorded.files()) };
    let single = recorded.folder.join("alone.mcap");
    let mut recorder = recorded.station.command("record");
    let recorder = recorder.arg(&single).stderr(Stdio::piped()).spawn().unwrap();
    until("a recording by itself", || states(&single) > 0);

    let mut delete = recorded.station.command("subject");
    delete.args(["delete", "anon-1", "--with-recordings", "--recordings"]).arg(&recorded.folder);
    let deleted = delete.output().unwrap();
    assert_eq!(deleted.status.code(), Some(0), "{}", describe_output(&deleted));
    assert!(
        !describe_output(&deleted).contains("NOT looked into"),
        "no process holds what was deleted: {}",
        describe_output(&deleted)
    );
    assert!(!first.exists() && !single.exists(), "{}", describe_output(&deleted));

    let ended = recorder.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(1), "{}", describe_output(&ended));
    assert!(
        describe_output(&ended).contains("removed or replaced while it was written"),
        "{}",
        describe_output(&ended)
    );

    let next = recorded.next_after(first);
    assert_eq!(Recording::open(&next).unwrap().header().subject_toml, "", "no subject is in use");
    // A foreign file under the name is handled the same way.
    std::fs::rename(&next, recorded.station.file("elsewhere.mcap")).unwrap();
    std::fs::write(&next, "somebody's").unwrap();
    recorded.next_after(&next);
    assert_eq!(std::fs::read(&next).unwrap(), b"somebody's");
    recorded.end();
}

/// Cycle numbers of the states in the readable part of a file.
fn state_numbers(path: &Path) -> Vec<u64> {
    let recording = Recording::open(path).unwrap();
    let number = |entry: Entry| match entry {
        Entry::State(state) => Some(state.cycle),
        _ => None,
    };
    recording.entries().map_while(Result::ok).filter_map(|timed| number(timed.entry)).collect()
}

/// Rates of the cycles in a file, by their number.
fn cycles_at(path: &Path, rate_hz: u64) -> usize {
    let recording = Recording::open(path).unwrap();
    let entries = recording.entries().map_while(Result::ok);
    let is =
        |entry: Entry| matches!(entry, Entry::Cycle(record) if record.period_ns == 1_000_000_000 / rate_hz);
    entries.filter(|timed| is(timed.entry.clone())).count()
}

#[test]
fn another_daemon_has_a_file_of_its_own_and_one_on_another_bus_is_found() {
    let mut recorded = Recorded::start();
    let first = recorded.files().pop().unwrap();
    until("cycles of the first daemon", || cycles_at(&first, 200) > 100);
    let config = recorded.config.replace("rate_hz = 200", "rate_hz = 500");
    recorded.station.restart(&config, |_| {});
    let second = recorded.next_after(&first);
    assert!(Recording::open(&second).unwrap().header().config_toml.contains("rate_hz = 500"));
    until("cycles of the new daemon", || cycles_at(&second, 500) > 500);
    assert_eq!(cycles_at(&second, 200), 0);
    assert_eq!(cycles_at(&first, 500), 0, "each file ends with its daemon");
    for file in [&first, &second] {
        let numbers = state_numbers(file);
        assert!(numbers.is_sorted_by(|a, b| a < b), "{}: a state of another daemon", file.display());
    }

    // The service manager recreates the bus's directory.
    let single = recorded.station.file("single.mcap");
    let mut recorder = recorded.station.command("record");
    let recorder = recorder.arg(&single).stderr(Stdio::piped()).spawn().unwrap();
    until("a recording by itself", || states(&single) > 0);
    recorded.station.restart(&config, |bus| std::fs::remove_dir_all(bus).unwrap());
    let ended = recorder.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(1), "{}", describe_output(&ended));
    assert!(describe_output(&ended).contains("removed or replaced"), "{}", describe_output(&ended));
    let third = recorded.next_after(&second);
    until("cycles on the new bus", || cycles_at(&third, 500) > 500);
    recorded.end();
}
