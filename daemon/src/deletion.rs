//! Deletes a subject for good: from running daemons, profiles, station files and, if asked, recordings.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use equipoise_adapters::recording::{Recording, RecordingHeader};

use crate::station_file::{self, StationFile};
use crate::whole_file::write_whole;
use crate::{profile, status};

/// How long a daemon may take to write its station's file anew.
const PATIENCE: Duration = Duration::from_secs(5);

/// What became of a subject.
#[derive(Debug, Default)]
pub struct Deletion {
    /// What running daemons said.
    pub daemons: Vec<String>,
    /// Files that are gone.
    pub deleted: Vec<PathBuf>,
    /// Files that do not mention the subject any more.
    pub changed: Vec<PathBuf>,
    /// Recordings that hold the subject and are still there.
    pub recordings: Vec<PathBuf>,
    /// What could not be looked into, and why.
    pub unknown: Vec<String>,
    /// Whether a daemon had the subject in use.
    was_in_use: bool,
    /// Stations whose daemons run: they write their files themselves.
    running: Vec<String>,
}

impl Deletion {
    /// Whether anything of the subject was found.
    pub fn found(&self) -> bool {
        let files = !(self.deleted.is_empty() && self.changed.is_empty() && self.recordings.is_empty());
        files || self.was_in_use
    }

    /// Has every running daemon of this bus forget the subject, so that none writes it again. `ask` asks the daemon of
    /// a station and gives back its sentence.
    ///
    /// # Errors
    /// A daemon runs and does not do it; nothing was deleted then.
    pub fn ask_daemons(&mut self, ask: impl Fn(&str) -> anyhow::Result<String>) -> anyhow::Result<()> {
        for facts in status::all() {
            match ask(&facts.station) {
                Ok(told) => {
                    self.was_in_use |= told.contains("was in use");
                    self.daemons.push(format!("station {}: {told}", facts.station));
                    self.running.push(facts.station);
                }
                Err(_) if !runs(facts.process_id) => {}
                Err(error) => {
                    let (station, id) = (&facts.station, facts.process_id);
                    return Err(error.context(format!(
                        "nothing is deleted: the daemon of station {station} (process {id}) might write it again; \
                         stop it first"
                    )));
                }
            }
        }
        Ok(())
    }

    /// Removes profile and leftovers, and the mentions in stations' files.
    ///
    /// # Errors
    /// A file cannot be removed or changed; those before it are.
    pub fn clear_state(&mut self, id: &str) -> anyhow::Result<()> {
        let own = format!("{id}.toml");
        let is_own = |path: &Path| {
            path.file_name().is_some_and(|name| {
                let name = name.to_string_lossy();
                name == own || name.strip_prefix(&own).is_some_and(|rest| rest.starts_with('.'))
            })
        };
        for path in files_in(&profile::folder()).filter(|path| is_own(path)) {
            fs::remove_file(&path).with_context(|| format!("cannot delete {}", path.display()))?;
            self.deleted.push(path);
        }
        sync(&profile::folder());
        for path in files_in(&station_file::folder()) {
            self.clear_station(id, path)?;
        }
        Ok(())
    }

    fn clear_station(&mut self, id: &str, path: PathBuf) -> anyhow::Result<()> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if let Some(station) = name.strip_suffix(".toml.new") {
            // What a kill left of a write; a daemon that runs has it under way.
            if !self.running.iter().any(|running| running == station) {
                fs::remove_file(&path).with_context(|| format!("cannot delete {}", path.display()))?;
            }
            return Ok(());
        }
        let names = |file: &StationFile| file.subject.as_ref().is_some_and(|subject| subject.in_use == id);
        match StationFile::read(&path) {
            Ok(Some(file)) if names(&file) && self.running.contains(&file.station) => {
                let asked = Instant::now();
                while StationFile::read(&path).is_ok_and(|file| file.as_ref().is_some_and(names)) {
                    if asked.elapsed() > PATIENCE {
                        bail!("{} still names {id}: its daemon does not write it", path.display());
                    }
                    std::thread::sleep(Duration::from_millis(20));
                }
                self.changed.push(path);
            }
            Ok(Some(mut file)) if names(&file) => {
                file.subject = None;
                write_whole(&path, file.to_toml().as_bytes())
                    .with_context(|| format!("cannot write {}", path.display()))?;
                self.changed.push(path);
            }
            Ok(_) => {}
            Err(why) => self.unknown.push(why.to_string()),
        }
        Ok(())
    }

    /// Finds recordings of the subject in a folder and those below it; removes them if `delete` says so.
    ///
    /// # Errors
    /// The folder cannot be read, or a recording cannot be removed.
    pub fn look_into_recordings(&mut self, id: &str, folder: &Path, delete: bool) -> anyhow::Result<()> {
        if !folder.is_dir() {
            bail!("--recordings {}: there is no such folder", folder.display());
        }
        for path in below(folder) {
            if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("mcap")) {
                continue;
            }
            match Recording::open(&path) {
                Ok(recording) if !holds(recording.header(), id) => {}
                Ok(_) if delete => {
                    fs::remove_file(&path).with_context(|| format!("cannot delete {}", path.display()))?;
                    sync(path.parent().unwrap_or(folder));
                    self.deleted.push(path);
                }
                Ok(_) => self.recordings.push(path),
                Err(why) => self.unknown.push(format!("{}: {why}", path.display())),
            }
        }
        Ok(())
    }
}

/// Whether a recording says that the subject is in it.
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

fn runs(process_id: u32) -> bool {
    Path::new("/proc").join(process_id.to_string()).exists()
}

fn files_in(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.is_file()).collect::<Vec<_>>().into_iter()
}

/// Every file below a folder; links are not followed.
fn below(folder: &Path) -> Vec<PathBuf> {
    let (mut files, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => folders.push(entry.path()),
                Ok(kind) if kind.is_file() => files.push(entry.path()),
                _ => {}
            }
        }
    }
    files.sort();
    files
}

/// A removal itself lies in the folder.
fn sync(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}
