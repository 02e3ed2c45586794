//! Stored data of one subject: the list that `subject export` copies and `subject delete` removes.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_adapters::recording::{Recording, RecordingHeader};
use equipoise_daemon::station_file::StationFile;
use equipoise_files::atomic_file::TemporaryFile;
use equipoise_recording::record::signature::{SIGNATURE_ENDING, signature_of};
use equipoise_station::state_directory::StateDirectory;

/// Data of a subject in one state directory.
#[derive(Debug, Default)]
pub struct StateData {
    /// Profile, list of lifts, and leftovers of their interrupted writes.
    pub profiles: Vec<PathBuf>,
    /// Lock that a daemon holds or a killed one left: no data.
    pub lock: Option<PathBuf>,
    /// Files of stations that have the subject in use.
    pub stations: Vec<(PathBuf, StationFile)>,
    /// Leftovers of interrupted writes in the folders of stations and flight records: their subject is unknown.
    pub leftovers: Vec<PathBuf>,
    /// All flight records, if anything of the subject was found: they contain motion data without a pseudonym, so they
    /// cannot be assigned to a subject.
    pub flights: Vec<PathBuf>,
    /// What could not be searched, and why.
    pub unknown: Vec<String>,
}

impl StateData {
    /// Lists the data. `is_in_use`: a daemon with this directory has the subject in use.
    ///
    /// # Errors
    /// A folder cannot be read.
    pub fn find(id: &str, directory: &StateDirectory, is_in_use: bool) -> anyhow::Result<StateData> {
        let mut data = StateData::default();
        // Subject ids contain no dot, so the prefix is unambiguous.
        let own = format!("{id}.");
        data.profiles = files_in(&directory.profiles())?;
        data.profiles.retain(|path| name_of(path).starts_with(&own));
        let lock = directory.lock(id);
        data.lock = data.profiles.contains(&lock).then(|| lock.clone());
        data.profiles.retain(|path| *path != lock);
        for path in files_in(&directory.stations())? {
            data.add_station_file(id, path);
        }
        if is_in_use || !(data.profiles.is_empty() && data.stations.is_empty()) {
            for path in files_in(&directory.flights())? {
                data.add_flight_file(path);
            }
        }
        Ok(data)
    }

    fn add_station_file(&mut self, id: &str, path: PathBuf) {
        if let Some(temporary) = TemporaryFile::named(&name_of(&path)) {
            // A running daemon may still be writing it.
            self.leftovers.extend(temporary.is_abandoned.then_some(path));
            return;
        }
        match StationFile::read(&path) {
            Ok(Some(file)) if names(&file, id) => self.stations.push((path, file)),
            Ok(_) => {}
            Err(reason) => self.unknown.push(reason.to_string()),
        }
    }

    fn add_flight_file(&mut self, path: PathBuf) {
        let name = name_of(&path);
        match TemporaryFile::named(&name) {
            Some(file) if file.is_abandoned && file.target.ends_with(".mcap") => self.leftovers.push(path),
            None if name.ends_with(".mcap") => self.flights.push(path),
            _ => {}
        }
    }
}

/// Whether a station's file has the subject in use.
pub fn names(file: &StationFile, id: &str) -> bool {
    file.subject.as_ref().is_some_and(|subject| subject.in_use == id)
}

/// Recordings of a subject in a folder and its subfolders.
#[derive(Debug, Default)]
pub struct RecordingData {
    /// The recordings.
    pub recordings: Vec<RecordingFile>,
    /// What could not be searched, and why.
    pub unknown: Vec<String>,
    /// Files that are not recordings by their name.
    pub skipped: Vec<PathBuf>,
}

/// A recording of a subject.
#[derive(Debug)]
pub struct RecordingFile {
    /// Path of the recording.
    pub path: PathBuf,
    /// Path of its signature, which exists if the recording is signed.
    pub signature: PathBuf,
    /// Pseudonyms of all its subjects.
    pub subjects: Vec<String>,
}

impl RecordingData {
    /// Lists the recordings.
    ///
    /// # Errors
    /// There is no such folder.
    pub fn find(id: &str, folder: &Path) -> anyhow::Result<RecordingData> {
        if !folder.is_dir() {
            bail!("--recordings {}: there is no such folder", folder.display());
        }
        let mut data = RecordingData::default();
        for path in data.below(folder) {
            if is_signature(&path) {
                continue;
            }
            if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("mcap")) {
                data.skipped.push(path);
                continue;
            }
            match Recording::open(&path) {
                Ok(recording) if holds(recording.header(), id) => {
                    let (signature, subjects) = (signature_of(&path), subjects_of(recording.header()));
                    data.recordings.push(RecordingFile { path, signature, subjects });
                }
                Ok(_) => {}
                Err(reason) => data.unknown.push(format!("{}: {reason}", path.display())),
            }
        }
        Ok(data)
    }

    /// All files below a folder; links are not followed, and unreadable folders are reported.
    fn below(&mut self, folder: &Path) -> Vec<PathBuf> {
        let (mut files, mut folders) = (Vec::new(), vec![folder.to_owned()]);
        while let Some(folder) = folders.pop() {
            let entries = match fs::read_dir(&folder) {
                Ok(entries) => entries,
                Err(reason) => {
                    self.unknown.push(format!("{}: {reason}", folder.display()));
                    continue;
                }
            };
            for entry in entries {
                let entry = match entry {
                    Ok(entry) => entry,
                    Err(reason) => {
                        self.unknown.push(format!("{}: {reason}", folder.display()));
                        continue;
                    }
                };
                match entry.file_type() {
                    Ok(kind) if kind.is_dir() => folders.push(entry.path()),
                    Ok(kind) if kind.is_file() => files.push(entry.path()),
                    _ => self.skipped.push(entry.path()),
                }
            }
        }
        files.sort();
        files
    }
}

/// Whether a file is the signature of a recording, by its name: it belongs to the recording and contains no personal
/// data.
fn is_signature(path: &Path) -> bool {
    name_of(path).strip_suffix(SIGNATURE_ENDING).is_some_and(|of| of.to_ascii_lowercase().ends_with(".mcap"))
}

/// Whether a recording's header names the subject.
fn holds(header: &RecordingHeader, id: &str) -> bool {
    let profiled = |text: &String| table(text).get("subject").and_then(toml::Value::as_str) == Some(id);
    let profiles = std::iter::once(&header.subject_toml).chain(&header.later_subjects_toml);
    let configs = std::iter::once(&header.config_toml)
        .chain(header.reloads.values().map(|reloaded| &reloaded.config_toml));
    profiles.into_iter().any(profiled)
        || configs.into_iter().any(|text| configured(text).as_deref() == Some(id))
}

fn subjects_of(header: &RecordingHeader) -> Vec<String> {
    header.subjects(&configured(&header.config_toml).unwrap_or_default())
}

fn configured(text: &str) -> Option<String> {
    Some(table(text).get("subject")?.get("id")?.as_str()?.to_owned())
}

fn table(text: &str) -> toml::Table {
    text.parse().unwrap_or_default()
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The files of a folder; none if the folder does not exist.
fn files_in(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let unread = || format!("cannot read {}: run this as the user of the daemon", folder.display());
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(unread),
    };
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.with_context(unread)?.path();
        if path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
