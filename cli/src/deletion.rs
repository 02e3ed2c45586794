//! Deletes a subject permanently: from running daemons, profiles, station files, flight records and, on request,
//! recordings.

use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_adapters::recording::{Recording, RecordingHeader};
use equipoise_daemon::station_file::StationFile;
use equipoise_files::atomic_file::{TemporaryFile, process_runs, remove_abandoned_files, write_atomically};
use equipoise_files::open_regular;
use equipoise_recording::record::signature::{SIGNATURE_ENDING, signature_of};
use equipoise_station::state_directory::{NoStateDirectory, StateDirectory};
use equipoise_station::status::{self, Status};

/// Time limit for a daemon to rewrite its station file, and for a recorder to close a file that was removed.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Result of a deletion.
#[derive(Debug, Default)]
pub struct Deletion {
    /// Replies of running daemons.
    pub daemons: Vec<String>,
    /// Deleted files.
    pub deleted: Vec<PathBuf>,
    /// Deleted flight records.
    pub flights: Vec<PathBuf>,
    /// Files from which mentions of the subject were removed.
    pub changed: Vec<PathBuf>,
    /// Recordings that contain the subject and still exist.
    pub recordings: Vec<PathBuf>,
    /// What could not be searched, and why.
    pub unknown: Vec<String>,
    /// Files in the recordings folder that are not recordings by their name.
    pub skipped: Vec<PathBuf>,
    /// Directories searched for the subject's files.
    pub directories: Vec<StateDirectory>,
    /// Daemons that had the subject in use.
    users: Vec<User>,
    /// Stations with a running daemon, which writes its files itself.
    running: Vec<String>,
}

/// A daemon that had the subject in use.
#[derive(Debug)]
struct User {
    station: String,
    directory: StateDirectory,
    /// Whether it writes profiles.
    stores_profiles: bool,
}

impl Deletion {
    /// Whether anything of the subject was found.
    pub fn found(&self) -> bool {
        let files = !(self.deleted.is_empty() && self.changed.is_empty() && self.recordings.is_empty());
        files || !self.users.is_empty()
    }

    /// Makes every running daemon of this bus remove the subject from memory, so that none writes it again. `request`
    /// sends the request to the daemon of a station and returns its reply.
    ///
    /// # Errors
    /// A running daemon does not comply or does not report its state directory, or it is unclear whether a daemon runs;
    /// nothing was deleted then.
    pub fn request_from_daemons(
        &mut self,
        request: impl Fn(&str) -> anyhow::Result<String>,
    ) -> anyhow::Result<()> {
        let all = status::all().context("nothing is deleted: a daemon might write it again")?;
        for facts in &all {
            if process_runs(facts.process_id) && StateDirectory::of_daemon(facts).is_none() {
                bail!(
                    "nothing is deleted: the daemon of station {} (process {}, version {}) does not say where its files \
                     are; restart it with this version first",
                    facts.station,
                    facts.process_id,
                    facts.version
                );
            }
        }
        for facts in all {
            // The state directory of a killed daemon is searched as well.
            let Some(directory) = StateDirectory::of_daemon(&facts) else { continue };
            match request(&facts.station) {
                Ok(answer) => {
                    if answer.contains("was in use") {
                        let (station, stores_profiles) = (facts.station.clone(), stores_profiles(&facts));
                        self.users.push(User { station, directory: directory.clone(), stores_profiles });
                    }
                    self.daemons.push(format!("station {}: {answer}", facts.station));
                    self.running.push(facts.station);
                }
                Err(_) if !process_runs(facts.process_id) => {}
                Err(error) => {
                    let (station, id) = (&facts.station, facts.process_id);
                    return Err(error.context(format!(
                        "nothing is deleted: the daemon of station {station} (process {id}) might write it again; \
                         stop it first"
                    )));
                }
            }
            directory.join_into(&mut self.directories);
        }
        Ok(())
    }

    /// Removes the profile, leftovers of interrupted writes, and the mentions in station files, in the state
    /// directories of all daemons and of the environment. If anything of the subject was found, all flight records are
    /// removed too: they contain motion data without a pseudonym, so they cannot be assigned to a subject.
    ///
    /// # Errors
    /// A file cannot be removed or changed; earlier removals persist. Or no state directory is available.
    pub fn clear_state(
        &mut self,
        id: &str,
        own: Result<StateDirectory, NoStateDirectory>,
    ) -> anyhow::Result<()> {
        match own {
            Ok(own) => own.join_into(&mut self.directories),
            Err(_) if !self.directories.is_empty() => {}
            Err(reason) => return Err(reason.into()),
        }
        for directory in self.directories.clone() {
            let before = self.deleted.len() + self.changed.len();
            self.clear_profiles(id, &directory)?;
            for path in files_in(&directory.stations())? {
                self.clear_station(id, path)?;
            }
            let used = self.users.iter().any(|user| user.directory.path() == directory.path());
            if used || self.deleted.len() + self.changed.len() > before {
                self.clear_flights(&directory.flights())?;
            }
        }
        Ok(())
    }

    /// Lists daemons that had the subject in use and keep profiles, but whose state directory held no file of it.
    pub fn missing(&self, id: &str) -> Option<String> {
        let has_files = |user: &User| {
            let profiles = user.directory.profiles().canonicalize().unwrap_or(user.directory.profiles());
            self.deleted.iter().any(|path| {
                let folder = path.parent().unwrap_or(path);
                folder.canonicalize().is_ok_and(|folder| folder == profiles)
            })
        };
        let user = self.users.iter().find(|user| user.stores_profiles && !has_files(user))?;
        Some(format!(
            "the daemon of station {} had {id} in use and has forgotten it, but there was no profile {id} in {}; if it was \
             saved before, that file is still somewhere else",
            user.station,
            user.directory.profiles().display()
        ))
    }

    fn clear_profiles(&mut self, id: &str, directory: &StateDirectory) -> anyhow::Result<()> {
        // Subject ids contain no dot, so the prefix is unambiguous.
        let own = format!("{id}.");
        let is_own =
            |path: &Path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&own));
        for path in files_in(&directory.profiles())?.into_iter().filter(|path| is_own(path)) {
            remove(&path)?;
            self.deleted.push(path);
        }
        sync(&directory.profiles());
        Ok(())
    }

    fn clear_flights(&mut self, folder: &Path) -> anyhow::Result<()> {
        let is_record = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "mcap");
        for path in files_in(folder)?.into_iter().filter(is_record) {
            remove(&path)?;
            self.flights.push(path);
        }
        remove_abandoned_files(folder, |of| of.ends_with(".mcap"));
        sync(folder);
        Ok(())
    }

    fn clear_station(&mut self, id: &str, path: PathBuf) -> anyhow::Result<()> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if let Some(temporary) = TemporaryFile::named(&name) {
            // Leftover of an interrupted write; a running daemon may still be writing it.
            return if temporary.is_abandoned { remove(&path) } else { Ok(()) };
        }
        let names = |file: &StationFile| file.subject.as_ref().is_some_and(|subject| subject.in_use == id);
        match StationFile::read(&path) {
            Ok(Some(file)) if names(&file) && self.running.contains(&file.station) => {
                let started = Instant::now();
                while StationFile::read(&path).is_ok_and(|file| file.as_ref().is_some_and(names)) {
                    if started.elapsed() > TIMEOUT {
                        bail!("{} still names {id}: its daemon does not write it", path.display());
                    }
                    std::thread::sleep(Duration::from_millis(20));
                }
                self.changed.push(path);
            }
            Ok(Some(mut file)) if names(&file) => {
                file.subject = None;
                let unwritten = || format!("cannot write {}", path.display());
                let text = file.to_toml().with_context(unwritten)?;
                write_atomically(&path, text.as_bytes()).with_context(unwritten)?;
                self.changed.push(path);
            }
            Ok(_) => {}
            Err(reason) => self.unknown.push(reason.to_string()),
        }
        Ok(())
    }

    /// Finds recordings of the subject in a folder and its subfolders; removes them if `delete` is set.
    ///
    /// # Errors
    /// The folder cannot be read, or a recording cannot be removed.
    pub fn search_recordings(&mut self, id: &str, folder: &Path, delete: bool) -> anyhow::Result<()> {
        if !folder.is_dir() {
            bail!("--recordings {}: there is no such folder", folder.display());
        }
        for path in self.below(folder) {
            if is_signature(&path) {
                continue;
            }
            if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("mcap")) {
                self.skipped.push(path);
                continue;
            }
            match Recording::open(&path) {
                Ok(recording) if !holds(recording.header(), id) => {}
                Ok(_) if delete => {
                    let written = being_written(&path);
                    remove(&path)?;
                    remove(&signature_of(&path))?;
                    sync(path.parent().unwrap_or(folder));
                    if written.is_some_and(|file| !is_released(&file)) {
                        self.unknown.push(format!(
                            "{}: its name is gone, but what writes it has it still open: stop that recorder, then it is \
                             gone",
                            path.display()
                        ));
                    }
                    self.deleted.push(path);
                }
                Ok(_) => self.recordings.push(path),
                Err(reason) => self.unknown.push(format!("{}: {reason}", path.display())),
            }
        }
        Ok(())
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
            for entry in entries.flatten() {
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

/// Whether a file is the signature of a recording, by its name: it is removed with the recording and contains no
/// personal data.
fn is_signature(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.strip_suffix(SIGNATURE_ENDING).is_some_and(|of| of.to_ascii_lowercase().ends_with(".mcap"))
}

/// Whether a recording's header names the subject.
fn holds(header: &RecordingHeader, id: &str) -> bool {
    let table = |text: &str| text.parse::<toml::Table>().unwrap_or_default();
    let configured = |text: &str| {
        table(text).get("subject").and_then(|subject| subject.get("id")).and_then(|found| found.as_str())
            == Some(id)
    };
    let profiled = |text: &str| table(text).get("subject").and_then(toml::Value::as_str) == Some(id);
    let profiles = std::iter::once(&header.subject_toml).chain(&header.later_subjects_toml);
    let configs = std::iter::once(&header.config_toml)
        .chain(header.reloads.values().map(|reloaded| &reloaded.config_toml));
    profiles.into_iter().any(|text| profiled(text)) || configs.into_iter().any(|text| configured(text))
}

/// Whether a daemon writes profiles, which is the default.
fn stores_profiles(facts: &Status) -> bool {
    let table = facts.config_toml.parse::<toml::Table>().unwrap_or_default();
    let subject = table.get("subject");
    // A daemon of the previous release uses the old name.
    let found =
        ["save_profile", "remember"].into_iter().find_map(|key| subject.and_then(|keys| keys.get(key)));
    found.and_then(toml::Value::as_bool).unwrap_or(true)
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

fn remove(path: &Path) -> anyhow::Result<()> {
    match fs::remove_file(path) {
        // The owner has already removed it, as daemons do with incomplete files.
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        removed => removed.with_context(|| format!("cannot delete {}", path.display())),
    }
}

/// Opens the recording if it is being written: a recorder holds a lock on its file.
fn being_written(path: &Path) -> Option<File> {
    let file = open_regular(path).ok()?;
    matches!(file.try_lock(), Err(TryLockError::WouldBlock)).then_some(file)
}

/// Waits until a removed file is no longer being written. A recorder detects within a second that its file was removed,
/// closes it and starts another, whose header does not contain the deleted subject.
fn is_released(file: &File) -> bool {
    let removed = Instant::now();
    while removed.elapsed() < TIMEOUT {
        if file.try_lock().is_ok() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    false
}

/// Makes the removal itself durable: it is an entry of the folder.
fn sync(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}
