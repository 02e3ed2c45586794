//! Flight records on disk: recordings in `flight/` under the state directory, each written atomically.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::Context;
use equipoise_adapters::recording::{Recorder, RecordingHeader};
use equipoise_config::Config;
use equipoise_files::atomic_file::{remove_abandoned_files, write_atomically};

use super::flight::Flight;
use crate::realtime::now_ns;

/// Maximum number of records per station; the oldest is removed.
pub const FILES_MAX: usize = 32;

/// The records of one station.
#[derive(Debug)]
pub struct FlightFiles {
    directory: PathBuf,
    station: String,
    header: RecordingHeader,
}

impl FlightFiles {
    /// The records of the configuration's station; the directory is created when needed.
    pub fn new(directory: &Path, config: &Config) -> FlightFiles {
        // Latencies do not depend on the subject: omit the pseudonym, so that none remains when a subject is deleted.
        let mut settled = config.clone().for_recording();
        equipoise_station::ANONYMOUS.clone_into(&mut settled.subject.id);
        FlightFiles {
            directory: directory.to_owned(),
            station: config.station.clone(),
            header: RecordingHeader {
                software_version: env!("CARGO_PKG_VERSION").to_owned(),
                config_toml: settled.to_toml(),
                ..RecordingHeader::default()
            },
        }
    }

    /// Writes a record as `STATION-cycle-N.mcap`, and removes the oldest record above the limit.
    ///
    /// # Errors
    /// The file that could not be written, and the reason.
    pub fn write(&self, flight: &Flight) -> anyhow::Result<PathBuf> {
        let path = self.free_path(flight.cycle);
        let bytes = self.recording(&path, flight)?;
        write_atomically(&path, &bytes).with_context(|| path.display().to_string())?;
        if let Err(error) = self.remove_oldest() {
            // An error means that no file was added: the caller tries again.
            let _ = fs::remove_file(&path);
            return Err(error).with_context(|| self.directory.display().to_string());
        }
        Ok(path)
    }

    /// Removes unfinished records of a killed daemon.
    pub fn clear_unfinished(&self) {
        remove_abandoned_files(&self.directory, |of| self.cycle_of(of).is_some());
    }

    fn recording(&self, path: &Path, flight: &Flight) -> anyhow::Result<Vec<u8>> {
        let started_ns = flight.outcomes.first().map_or(0, |outcome| outcome.record.due_ns);
        let header = RecordingHeader {
            started_monotonic_ns: started_ns,
            started_unix_ns: unix_ns().saturating_sub(now_ns().saturating_sub(started_ns)),
            ..self.header.clone()
        };
        let mut recorder = Recorder::in_memory(path, &header)?;
        for outcome in &flight.outcomes {
            recorder.write(outcome.record.due_ns, &outcome.record)?;
            recorder.write(outcome.state.time_ns, &outcome.state)?;
        }
        Ok(recorder.into_bytes()?)
    }

    /// A path that does not exist yet: cycles restart at 1 with each daemon, so a number may repeat, and the older
    /// record is kept.
    fn free_path(&self, cycle: u64) -> PathBuf {
        let name = |number: u32| match number {
            1 => format!("{}-cycle-{cycle}.mcap", self.station),
            number => format!("{}-cycle-{cycle}-{number}.mcap", self.station),
        };
        let path = |number| self.directory.join(name(number));
        // One more candidate than the maximum number of files, so one is free.
        (1..=FILES_MAX as u32 + 1).map(path).find(|path| !path.exists()).unwrap_or_else(|| path(1))
    }

    /// The cycle number in the name of a file of this station; `None` for other files.
    fn cycle_of(&self, name: &str) -> Option<u64> {
        let numbers = name.strip_prefix(&self.station)?.strip_prefix("-cycle-")?.strip_suffix(".mcap")?;
        let (cycle, number) = numbers.split_once('-').unwrap_or((numbers, "1"));
        number.parse::<u32>().ok()?;
        cycle.parse().ok()
    }

    fn remove_oldest(&self) -> io::Result<()> {
        let mut records: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        for entry in fs::read_dir(&self.directory)? {
            let entry = entry?;
            if let Some(cycle) = self.cycle_of(&entry.file_name().to_string_lossy()) {
                records.push((entry.metadata()?.modified()?, cycle, entry.path()));
            }
        }
        records.sort();
        let too_many = records.len().saturating_sub(FILES_MAX);
        records.iter().take(too_many).try_for_each(|(_, _, path)| fs::remove_file(path))
    }
}

fn unix_ns() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    use bytemuck::Zeroable;
    use equipoise_adapters::recording::{Entry, Recording};
    use equipoise_core::message::{CycleRecord, State};

    use crate::rings::Outcome;

    fn files(directory: &Path) -> FlightFiles {
        let text = "station = \"s-1\"\n[suit]\nsource = \"external\"\n[ground]\nsource = \"external\"\n[subject]\nid = \
                    \"a\"\nheight_m = 1.77\n";
        FlightFiles::new(directory, &Config::parse(text, "the test's").unwrap())
    }

    fn flight(cycle: u64) -> Flight {
        let outcome = |cycle: u64| Outcome {
            state: State { cycle, time_ns: cycle * 1000, ..State::zeroed() },
            record: CycleRecord { cycle, due_ns: cycle * 1000, ..CycleRecord::zeroed() },
        };
        Flight { cycle, outcomes: (cycle - 2..cycle + 2).map(outcome).collect() }
    }

    fn names(directory: &Path) -> Vec<String> {
        let entries = fs::read_dir(directory).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_record_is_a_recording_with_every_cycle_and_its_state() {
        let directory = tempfile::tempdir().unwrap();
        let path = files(&directory.path().join("flight")).write(&flight(70)).unwrap();
        assert!(path.ends_with("flight/s-1-cycle-70.mcap"), "{}", path.display());
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
        let recording = Recording::open(&path).unwrap();
        assert!(!recording.truncated());
        assert!(recording.header().config_toml.contains("s-1"));
        assert_eq!(recording.header().started_monotonic_ns, 68_000);
        let (mut cycles, mut states) = (Vec::new(), Vec::new());
        for entry in recording.entries() {
            match entry.unwrap().entry {
                Entry::Cycle(record) => cycles.push(record.cycle),
                Entry::State(state) => states.push(state.cycle),
                other => panic!("{other:?}"),
            }
        }
        assert_eq!((cycles, states), (vec![68, 69, 70, 71], vec![68, 69, 70, 71]));
    }

    #[test]
    fn the_oldest_record_above_the_limit_is_removed_and_no_file_of_others() {
        let directory = tempfile::tempdir().unwrap();
        let foreign = ["s-10-cycle-5.mcap", "s-1-cycle-x.mcap", "s-1-cycle-5.mcap.txt", "note"];
        for name in foreign {
            fs::write(directory.path().join(name), "").unwrap();
        }
        let files = files(directory.path());
        let last = 10 + FILES_MAX as u64 + 7;
        for cycle in 10..=last {
            files.write(&flight(cycle)).unwrap();
        }
        let own_cycle = |name: &String| files.cycle_of(name);
        let mut cycles: Vec<u64> = names(directory.path()).iter().filter_map(own_cycle).collect();
        cycles.sort_unstable();
        assert_eq!(cycles, (last - FILES_MAX as u64 + 1..=last).collect::<Vec<_>>());
        for name in foreign {
            assert!(directory.path().join(name).exists(), "{name}");
        }
    }

    #[test]
    fn files_of_another_run_are_not_overwritten_and_incomplete_ones_removed() {
        let directory = tempfile::tempdir().unwrap();
        let files = files(directory.path());
        for _ in 0..3 {
            files.write(&flight(9)).unwrap();
        }
        for name in ["s-1-cycle-4.mcap.new", "s-1-cycle-5.mcap.4194305-0.new"] {
            fs::write(directory.path().join(name), "half").unwrap();
        }
        files.clear_unfinished();
        let expected = ["s-1-cycle-9-2.mcap", "s-1-cycle-9-3.mcap", "s-1-cycle-9.mcap"];
        assert_eq!(names(directory.path()), expected);
    }

    #[test]
    fn write_errors_are_reported() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("file");
        fs::write(&file, "no directory").unwrap();
        let message = format!("{:#}", files(&file.join("flight")).write(&flight(9)).unwrap_err());
        assert!(message.contains("s-1-cycle-9.mcap"), "{message}");
    }

    #[test]
    fn no_record_is_added_while_the_oldest_cannot_be_removed() {
        let directory = tempfile::tempdir().unwrap();
        fs::create_dir(directory.path().join("s-1-cycle-1.mcap")).unwrap();
        let files = files(directory.path());
        for cycle in 10..9 + FILES_MAX as u64 {
            files.write(&flight(cycle)).unwrap();
        }
        for _ in 0..2 {
            files.write(&flight(100)).unwrap_err();
            assert_eq!(names(directory.path()).len(), FILES_MAX);
        }
    }
}
