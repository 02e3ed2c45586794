//! Copies all stored data of a subject for a data-protection request, by the list of [`crate::subject_data`].

mod archive;
mod output;

use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use anyhow::Context;
use equipoise_files::atomic_file::TemporaryFile;
use equipoise_files::open_regular;
use equipoise_station::state_directory::{NoStateDirectory, StateDirectory};
use equipoise_station::status::{self, Status};
use serde::Serialize;

use crate::subject_data::{RecordingData, StateData};
use output::Output;

/// Name of the list of contents.
pub const INDEX: &str = "index.json";

/// The stored data of a subject.
#[derive(Debug, Default)]
pub struct SubjectExport {
    /// Files to copy.
    pub files: Vec<SubjectFile>,
    /// Recordings of the subject that are not copied.
    pub not_copied: Vec<PathBuf>,
    /// What could not be searched or read, and why.
    pub unknown: Vec<String>,
    /// Files in the recordings folder that are not recordings by their name.
    pub skipped: Vec<PathBuf>,
    /// Directories searched for the subject's files.
    pub directories: Vec<StateDirectory>,
    /// Daemons that have the subject in use.
    daemons: Vec<Daemon>,
}

/// A file of the subject.
#[derive(Debug)]
pub struct SubjectFile {
    /// Path on this machine.
    pub path: PathBuf,
    /// Name in the export.
    name: PathBuf,
    content: Content,
    /// Pseudonyms of all subjects of a recording.
    subjects: Vec<String>,
}

/// What a file contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Content {
    Profile,
    Station,
    Recording,
    Signature,
    /// Motion data without a pseudonym, from the same state directory.
    FlightRecord,
    /// Leftover of an interrupted write.
    Leftover,
}

impl Content {
    /// Whether the file may be of another subject.
    fn is_uncertain(self) -> bool {
        matches!(self, Content::FlightRecord | Content::Leftover)
    }
}

/// Status of a daemon that has the subject in use.
#[derive(Debug, Serialize)]
struct Daemon {
    station: String,
    /// Active incidents: the daemon's message by name.
    incidents: std::collections::BTreeMap<String, String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    model_mismatch: Option<String>,
    /// Messages on restored data of earlier runs.
    restored: Vec<String>,
}

/// List of contents, as JSON.
#[derive(Serialize)]
struct Index<'a> {
    subject: &'a str,
    software_version: &'static str,
    files: Vec<IndexEntry<'a>>,
    daemons: &'a [Daemon],
    recordings_not_copied: Vec<String>,
    not_searched: &'a [String],
}

#[derive(Serialize)]
struct IndexEntry<'a> {
    file: &'a Path,
    content: Content,
    /// Whether it may be of another subject.
    may_be_of_another_subject: bool,
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    subjects: &'a [String],
}

impl SubjectExport {
    /// Lists the data in the state directories of all daemons of this bus and of the environment.
    ///
    /// # Errors
    /// The list of daemons is incomplete, a folder cannot be read, or no state directory is available.
    pub fn find(id: &str, own: Result<StateDirectory, NoStateDirectory>) -> anyhow::Result<SubjectExport> {
        let mut export = SubjectExport::default();
        let all = status::all().context("nothing is exported: the list of daemons is incomplete")?;
        for directory in all.iter().filter_map(StateDirectory::of_daemon) {
            directory.join_into(&mut export.directories);
        }
        match own {
            Ok(own) => own.join_into(&mut export.directories),
            Err(_) if !export.directories.is_empty() => {}
            Err(reason) => return Err(reason.into()),
        }
        let using: Vec<Status> = all.into_iter().filter(|facts| facts.subject == id).collect();
        for (index, directory) in export.directories.clone().iter().enumerate() {
            let is_here = |facts: &Status| StateDirectory::of_daemon(facts).as_ref() == Some(directory);
            let data = StateData::find(id, directory, using.iter().any(is_here))?;
            let folder = match export.directories.len() {
                1 => PathBuf::from("state"),
                _ => PathBuf::from(format!("state-{}", index + 1)),
            };
            export.add_state(data, directory, &folder);
        }
        export.daemons = using.into_iter().map(Daemon::of).collect();
        Ok(export)
    }

    fn add_state(&mut self, data: StateData, directory: &StateDirectory, folder: &Path) {
        let stations = data.stations.into_iter().map(|(path, _)| path).collect();
        for (paths, content) in [
            (data.profiles, Content::Profile),
            (stations, Content::Station),
            (data.leftovers, Content::Leftover),
            (data.flights, Content::FlightRecord),
        ] {
            self.files.extend(paths.into_iter().map(|path: PathBuf| {
                let name = folder.join(path.strip_prefix(directory.path()).unwrap_or(&path));
                SubjectFile { name, path, content, subjects: Vec::new() }
            }));
        }
        self.unknown.extend(data.unknown);
    }

    /// Lists the recordings of the subject in a folder and its subfolders, to copy them if `copy` is set.
    ///
    /// # Errors
    /// There is no such folder.
    pub fn search_recordings(&mut self, id: &str, folder: &Path, copy: bool) -> anyhow::Result<()> {
        let data = RecordingData::find(id, folder)?;
        self.unknown.extend(data.unknown);
        self.skipped.extend(data.skipped);
        for recording in data.recordings {
            if !copy {
                self.not_copied.push(recording.path);
                continue;
            }
            let name = |path: &Path| Path::new("recordings").join(path.strip_prefix(folder).unwrap_or(path));
            if recording.signature.is_file() {
                let (name, path) = (name(&recording.signature), recording.signature);
                self.files.push(SubjectFile {
                    name,
                    path,
                    content: Content::Signature,
                    subjects: Vec::new(),
                });
            }
            let (name, subjects) = (name(&recording.path), recording.subjects);
            self.files.push(SubjectFile {
                name,
                path: recording.path,
                content: Content::Recording,
                subjects,
            });
        }
        Ok(())
    }

    /// Whether anything of the subject was found.
    pub fn found(&self) -> bool {
        !(self.files.iter().all(|file| file.content.is_uncertain())
            && self.not_copied.is_empty()
            && self.daemons.is_empty())
    }

    /// Whether a file may be of another subject.
    pub fn has_uncertain(&self) -> bool {
        self.files.iter().any(|file| file.content.is_uncertain())
    }

    /// Files with the data of other subjects besides this one.
    pub fn shared<'a>(&'a self, id: &'a str) -> impl Iterator<Item = &'a SubjectFile> {
        self.files.iter().filter(move |file| file.subjects.iter().any(|subject| subject != id))
    }

    /// Copies the files and the list of contents to a folder or a `.tar` file. A file that no longer exists is listed in
    /// `unknown`, unless it was a write in progress, which is now complete. `progress` receives the completed fraction.
    ///
    /// # Errors
    /// The output exists, or a file cannot be copied.
    pub fn write(&mut self, id: &str, out: &Path, progress: &mut dyn FnMut(f64)) -> anyhow::Result<()> {
        let mut output = Output::create(out)?;
        let total = self.files.iter().filter_map(|file| file.path.metadata().ok()).map(|file| file.len());
        let total = total.sum::<u64>().max(1);
        let (mut copied, mut index) = (0, 0);
        while let Some(file) = self.files.get(index) {
            let failed = || format!("cannot copy {}", file.path.display());
            let source = match open_regular(&file.path) {
                Err(error) if error.kind() == ErrorKind::NotFound => {
                    let file = self.files.remove(index);
                    match file.written() {
                        None => self.unknown.push(format!("{} was removed meanwhile", file.path.display())),
                        Some(written) if self.files.iter().any(|other| other.path == written.path) => {}
                        Some(written) => self.files.push(written),
                    }
                    continue;
                }
                opened => opened.with_context(failed)?,
            };
            let length = source.metadata().with_context(failed)?.len();
            let mut content = Counted { source, copied: &mut copied, total, progress: &mut *progress };
            output.add(&file.name, &mut content, length).with_context(failed)?;
            index += 1;
        }
        let index = serde_json::to_vec_pretty(&self.index(id))?;
        output.add(Path::new(INDEX), &mut &*index, index.len() as u64).context("cannot write the index")?;
        output.finish()
    }

    fn index<'a>(&'a self, id: &'a str) -> Index<'a> {
        let entry = |file: &'a SubjectFile| IndexEntry {
            file: &file.name,
            content: file.content,
            may_be_of_another_subject: file.content.is_uncertain(),
            subjects: &file.subjects,
        };
        Index {
            subject: id,
            software_version: env!("CARGO_PKG_VERSION"),
            files: self.files.iter().map(entry).collect(),
            daemons: &self.daemons,
            recordings_not_copied: self.not_copied.iter().map(|path| path.display().to_string()).collect(),
            not_searched: &self.unknown,
        }
    }
}

impl SubjectFile {
    /// The file of which this one, if it is temporary, becomes the content when its write is complete.
    fn written(&self) -> Option<SubjectFile> {
        let name = self.path.file_name()?.to_str()?;
        let target = TemporaryFile::named(name)?.target;
        let path = self.path.with_file_name(target);
        Some(SubjectFile { name: self.name.with_file_name(target), path, subjects: Vec::new(), ..*self })
    }
}

impl Daemon {
    fn of(facts: Status) -> Daemon {
        let Status { station, incidents, model_mismatch, restored, .. } = facts;
        Daemon { station, incidents, model_mismatch, restored }
    }
}

/// A file whose bytes are counted while it is read.
struct Counted<'a, R> {
    source: R,
    copied: &'a mut u64,
    total: u64,
    progress: &'a mut dyn FnMut(f64),
}

impl<R: Read> Read for Counted<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.source.read(buffer)?;
        *self.copied += count as u64;
        (self.progress)(*self.copied as f64 / self.total as f64);
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_write_that_completes_meanwhile_is_exported_under_its_final_name() {
        let state = tempfile::tempdir().expect("a folder");
        let file = |name: &str, content| SubjectFile {
            name: PathBuf::from(name),
            path: state.path().join(name),
            content,
            subjects: Vec::new(),
        };
        std::fs::write(state.path().join("a.toml"), "a").expect("a file");
        std::fs::write(state.path().join("b.toml"), "b").expect("a file");
        let files = vec![
            file("a.toml", Content::Profile),
            file("a.toml.7-1.new", Content::Profile),
            file("b.toml.7-2.new", Content::Profile),
            file("c.toml", Content::Profile),
        ];
        let mut export = SubjectExport { files, ..SubjectExport::default() };
        let out = state.path().join("out");
        export.write("a", &out, &mut |_| {}).expect("an export");
        let names: Vec<_> = export.files.iter().map(|file| file.name.display().to_string()).collect();
        assert_eq!(names, ["a.toml", "b.toml"]);
        assert_eq!(std::fs::read_to_string(out.join("b.toml")).expect("a copy"), "b");
        assert_eq!(
            export.unknown,
            [format!("{} was removed meanwhile", state.path().join("c.toml").display())]
        );
    }
}
