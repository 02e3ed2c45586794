//! Deletes a subject permanently: from running daemons, profiles, station files, flight records and, on request,
//! recordings.

use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_daemon::station_file::StationFile;
use equipoise_files::atomic_file::{process_runs, write_atomically};
use equipoise_files::open_regular;
use equipoise_station::state_directory::{NoStateDirectory, StateDirectory};
use equipoise_station::status::{self, Status};

use crate::subject_data::{RecordingData, RecordingFile, StateData, names};

/// Time limit for a daemon to rewrite its station file, and for a recorder to close a file that was removed. Both take a
/// second; on two cores with four other computing processes a recorder took more than 5 s.
const TIMEOUT: Duration = Duration::from_secs(20);

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
    /// Station and state directory of each running daemon, which writes its files itself.
    running: Vec<(String, StateDirectory)>,
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
                    self.running.push((facts.station, directory.clone()));
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
            let is_used = self.users.iter().any(|user| user.directory.path() == directory.path());
            let data = StateData::find(id, &directory, is_used)?;
            for path in data.profiles {
                remove(&path)?;
                self.deleted.push(path);
            }
            sync(&directory.profiles());
            for (path, file) in data.stations {
                self.clear_station(id, &directory, path, file)?;
            }
            for path in data.leftovers.into_iter().chain(data.lock) {
                remove(&path)?;
            }
            for path in data.flights {
                remove(&path)?;
                self.flights.push(path);
            }
            sync(&directory.flights());
            self.unknown.extend(data.unknown);
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

    /// Removes the subject from a station's file in a state directory.
    fn clear_station(
        &mut self,
        id: &str,
        directory: &StateDirectory,
        path: PathBuf,
        mut file: StationFile,
    ) -> anyhow::Result<()> {
        let is_written = |(station, of): &(String, StateDirectory)| {
            *station == file.station && is_same(of.path(), directory.path())
        };
        if self.running.iter().any(is_written) {
            // Its daemon writes it itself.
            let started = Instant::now();
            while StationFile::read(&path).is_ok_and(|file| file.is_some_and(|file| names(&file, id))) {
                if started.elapsed() > TIMEOUT {
                    bail!("{} still names {id}: its daemon does not write it", path.display());
                }
                std::thread::sleep(Duration::from_millis(20));
            }
        } else {
            file.clear_subject();
            let unwritten = || format!("cannot write {}", path.display());
            let text = file.to_toml().with_context(unwritten)?;
            write_atomically(&path, text.as_bytes()).with_context(unwritten)?;
        }
        self.changed.push(path);
        Ok(())
    }

    /// Finds recordings of the subject in a folder and its subfolders; removes them if `delete` is set.
    ///
    /// # Errors
    /// The folder cannot be read, or a recording cannot be removed.
    pub fn search_recordings(&mut self, id: &str, folder: &Path, delete: bool) -> anyhow::Result<()> {
        let data = RecordingData::find(id, folder)?;
        self.unknown.extend(data.unknown);
        self.skipped.extend(data.skipped);
        for RecordingFile { path, signature, .. } in data.recordings {
            if !delete {
                self.recordings.push(path);
                continue;
            }
            let written = being_written(&path);
            remove(&path)?;
            remove(&signature)?;
            sync(path.parent().unwrap_or(folder));
            if written.is_some_and(|file| !is_released(&file)) {
                self.unknown.push(format!(
                    "{}: its name is gone, but what writes it has it still open: stop that recorder, then it is gone",
                    path.display()
                ));
            }
            self.deleted.push(path);
        }
        Ok(())
    }
}

/// Whether two paths refer to the same directory.
fn is_same(a: &Path, b: &Path) -> bool {
    a == b || matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
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
