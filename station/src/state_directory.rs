//! Location of persistent state: profiles, station files, flight records.
//!
//! The location comes from the service manager and is in the daemon's environment only. The daemon publishes it in its
//! status for other programs, which use their own environment if no daemon runs.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::{fs, io};

use crate::status::{self, Status};

/// Neither the service manager nor a home directory determines the location of the state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "no directory for persistent state: set STATE_DIRECTORY to a directory of this user (neither it nor \
     XDG_STATE_HOME nor HOME is set)"
)]
pub struct NoStateDirectory;

/// A state directory; its path is absolute.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StateDirectory(PathBuf);

impl StateDirectory {
    /// The directory of the environment: systemd's `$STATE_DIRECTORY`, else `$XDG_STATE_HOME/equipoise`, else
    /// `~/.local/state/equipoise`.
    ///
    /// # Errors
    /// None of them is set. World-writable folders are not used, because the state contains personal data.
    pub fn of_environment() -> Result<StateDirectory, NoStateDirectory> {
        choose(|name| std::env::var_os(name)).map(|path| StateDirectory::at(&path)).ok_or(NoStateDirectory)
    }

    /// A directory at `path`.
    pub fn at(path: &Path) -> StateDirectory {
        StateDirectory(std::path::absolute(path).unwrap_or_else(|_| path.to_owned()))
    }

    /// The directory of a daemon; `None` if its version does not publish it.
    pub fn of_daemon(facts: &Status) -> Option<StateDirectory> {
        let path = &facts.state_directory;
        (!path.as_os_str().is_empty()).then(|| StateDirectory::at(path))
    }

    /// The directory of a station's daemon, otherwise that of the environment.
    ///
    /// # Errors
    /// Neither is available.
    pub fn of_station(station: &str) -> Result<StateDirectory, NoStateDirectory> {
        let published = status::read(station).as_ref().and_then(StateDirectory::of_daemon);
        published.map_or_else(StateDirectory::of_environment, Ok)
    }

    /// The directories of all daemons on this bus without duplicates; without a daemon, that of the environment.
    ///
    /// # Errors
    /// A daemon's status cannot be read, or no directory is available.
    pub fn of_bus() -> anyhow::Result<Vec<StateDirectory>> {
        let mut all = Vec::new();
        for facts in status::all()? {
            if let Some(directory) = StateDirectory::of_daemon(&facts) {
                directory.join_into(&mut all);
            }
        }
        if all.is_empty() {
            all.push(StateDirectory::of_environment()?);
        }
        Ok(all)
    }

    /// Appends the directory unless the list contains it, possibly under another path.
    pub fn join_into(self, others: &mut Vec<StateDirectory>) {
        let real = |directory: &StateDirectory| directory.0.canonicalize().unwrap_or(directory.0.clone());
        if others.iter().all(|other| real(other) != real(&self)) {
            others.push(self);
        }
    }

    /// Path of the directory.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Folder of the profiles.
    pub fn profiles(&self) -> PathBuf {
        self.0.join("subjects")
    }

    /// Paths of all profiles, sorted; none without the folder.
    pub fn profile_files(&self) -> io::Result<Vec<PathBuf>> {
        let entries = match fs::read_dir(self.profiles()) {
            Ok(entries) => entries,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(error),
        };
        let mut files: Vec<PathBuf> = entries.filter_map(Result::ok).map(|entry| entry.path()).collect();
        files.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
        files.sort();
        Ok(files)
    }

    /// Path of the results of a subject's load checks.
    pub fn load_checks(&self, subject: &str) -> PathBuf {
        self.profiles().join(format!("{subject}.load-checks.jsonl"))
    }

    /// Path of a subject's list of lifts.
    pub fn lifts(&self, subject: &str) -> PathBuf {
        self.profiles().join(format!("{subject}.lifts.csv"))
    }

    /// Path of a subject's profile; the configuration validates the id.
    pub fn profile(&self, subject: &str) -> PathBuf {
        self.profiles().join(format!("{subject}.toml"))
    }

    /// Path of the lock that the daemon with a subject in use holds.
    pub fn lock(&self, subject: &str) -> PathBuf {
        self.profiles().join(format!("{subject}.lock"))
    }

    /// Folder of the station files.
    pub fn stations(&self) -> PathBuf {
        self.0.join("stations")
    }

    /// Path of a station's file; the configuration validates the name.
    pub fn station(&self, station: &str) -> PathBuf {
        self.stations().join(format!("{station}.toml"))
    }

    /// Folder of the flight records.
    pub fn flights(&self) -> PathBuf {
        self.0.join("flight")
    }
}

fn choose(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let set = |name: &str| variable(name).filter(|value| !value.is_empty());
    if let Some(directories) = set("STATE_DIRECTORY") {
        // systemd separates several directories by colons; the first is the service's own.
        let first = directories.to_string_lossy().split(':').next().unwrap_or_default().to_owned();
        return (!first.is_empty()).then(|| PathBuf::from(first));
    }
    match (set("XDG_STATE_HOME"), set("HOME")) {
        (Some(state), _) => Some(PathBuf::from(state).join("equipoise")),
        (None, Some(home)) => Some(PathBuf::from(home).join(".local/state/equipoise")),
        (None, None) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_service_manager_has_precedence_and_without_a_home_there_is_no_directory() {
        let of = |set: &[(&str, &str)]| {
            choose(|name| set.iter().find(|(set, _)| *set == name).map(|(_, value)| OsString::from(value)))
        };
        let home = ("HOME", "/h");
        assert_eq!(of(&[("STATE_DIRECTORY", "/a:/b"), home]), Some(PathBuf::from("/a")));
        assert_eq!(of(&[("STATE_DIRECTORY", ""), home]), Some(PathBuf::from("/h/.local/state/equipoise")));
        assert_eq!(of(&[("XDG_STATE_HOME", "/x"), home]), Some(PathBuf::from("/x/equipoise")));
        assert_eq!(of(&[]), None);
    }

    #[test]
    fn a_directory_of_two_names_counts_once() {
        let directory = tempfile::tempdir().unwrap();
        let (real, link) = (directory.path().join("real"), directory.path().join("link"));
        fs::create_dir(&real).unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        let mut all = Vec::new();
        for path in [&real, &link, &directory.path().join("other")] {
            StateDirectory::at(path).join_into(&mut all);
        }
        assert_eq!(all.len(), 2);
    }
}
