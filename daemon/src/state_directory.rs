//! Where state lies: profiles, stations' files, flight records.
//!
//! Only the service manager tells the daemon where. So the daemon tells it on in its status, and whoever deals with its
//! files goes there; the environment counts where no daemon runs.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::status::{self, Status};

/// Neither the service manager nor a home says where state lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "nothing says where state is to be kept: set STATE_DIRECTORY to a directory of this user (neither it nor \
     XDG_STATE_HOME nor HOME is set)"
)]
pub struct NoStateDirectory;

/// A state directory; its path is absolute.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StateDirectory(PathBuf);

impl StateDirectory {
    /// That of the environment: systemd's `$STATE_DIRECTORY`, else `$XDG_STATE_HOME/equipoise`, else
    /// `~/.local/state/equipoise`.
    ///
    /// # Errors
    /// None of them is set. A folder that everybody may make would be no place for what is known of people.
    pub fn of_environment() -> Result<StateDirectory, NoStateDirectory> {
        choose(|name| std::env::var_os(name)).map(|path| StateDirectory::at(&path)).ok_or(NoStateDirectory)
    }

    /// This one.
    pub fn at(path: &Path) -> StateDirectory {
        StateDirectory(std::path::absolute(path).unwrap_or_else(|_| path.to_owned()))
    }

    /// That of a daemon; `None` if it is of a version that does not tell.
    pub fn of_daemon(facts: &Status) -> Option<StateDirectory> {
        let path = &facts.state_directory;
        (!path.as_os_str().is_empty()).then(|| StateDirectory::at(path))
    }

    /// That of a station's daemon, else that of the environment.
    ///
    /// # Errors
    /// There is neither.
    pub fn of_station(station: &str) -> Result<StateDirectory, NoStateDirectory> {
        let told = status::read(station).as_ref().and_then(StateDirectory::of_daemon);
        told.map_or_else(StateDirectory::of_environment, Ok)
    }

    /// Those of all daemons on this bus, each once; if there are none, that of the environment.
    ///
    /// # Errors
    /// A daemon's status cannot be read, or there is no directory at all.
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

    /// Adds it to others, unless it is there already, be it by another name.
    pub fn join_into(self, others: &mut Vec<StateDirectory>) {
        let real = |directory: &StateDirectory| directory.0.canonicalize().unwrap_or(directory.0.clone());
        if others.iter().all(|other| real(other) != real(&self)) {
            others.push(self);
        }
    }

    /// The directory itself.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Where profiles are kept.
    pub fn profiles(&self) -> PathBuf {
        self.0.join("subjects")
    }

    /// The list of a subject's lifts.
    pub fn lifts(&self, subject: &str) -> PathBuf {
        self.profiles().join(format!("{subject}.lifts.csv"))
    }

    /// The file of a subject; the id is checked by the configuration.
    pub fn profile(&self, subject: &str) -> PathBuf {
        self.profiles().join(format!("{subject}.toml"))
    }

    /// Where the stations' files are kept.
    pub fn stations(&self) -> PathBuf {
        self.0.join("stations")
    }

    /// The file of a station; the name is checked by the configuration.
    pub fn station(&self, station: &str) -> PathBuf {
        self.stations().join(format!("{station}.toml"))
    }

    /// Where flight records are kept.
    pub fn flights(&self) -> PathBuf {
        self.0.join("flight")
    }
}

fn choose(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let set = |name: &str| variable(name).filter(|value| !value.is_empty());
    if let Some(directories) = set("STATE_DIRECTORY") {
        // systemd joins several with colons; the first is the service's own.
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
    fn the_service_manager_comes_first_and_without_a_home_there_is_none() {
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
        std::fs::create_dir(&real).unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        let mut all = Vec::new();
        for path in [&real, &link, &directory.path().join("other")] {
            StateDirectory::at(path).join_into(&mut all);
        }
        assert_eq!(all.len(), 2);
    }
}
