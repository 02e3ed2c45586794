//! Remedy for a configuration file that cannot be read: names existing configuration files.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use equipoise_files::{TEXT_BYTES_MAX, read_text};

/// Folder of the installed configuration.
const INSTALLED: &str = "/etc/equipoise";
/// Maximum number of files that a message names.
const NAMED_MAX: usize = 4;

/// What to do if the configuration `path` cannot be read because of `error`.
pub(crate) fn remedy(path: &Path, error: &io::Error) -> String {
    if error.kind() == ErrorKind::PermissionDenied {
        return "run the command as a user that may read it".to_owned();
    }
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(path) };
    among(&[folder, Path::new("."), Path::new(INSTALLED)])
}

fn among(folders: &[&Path]) -> String {
    let mut files: Vec<PathBuf> = Vec::new();
    for file in folders.iter().flat_map(|folder| configurations_in(folder)) {
        if !files.contains(&file) {
            files.push(file);
        }
    }
    files.truncate(NAMED_MAX);
    let names: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
    match names.as_slice() {
        [] => format!("name an existing file; `equipoise install` creates {INSTALLED}/equipoise.toml"),
        names => format!("name an existing file: {}", names.join(", ")),
    }
}

/// The files in a folder that name a station, sorted; none if the folder cannot be read.
fn configurations_in(folder: &Path) -> Vec<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "toml"));
    files.sort();
    let names_station = |file: &PathBuf| {
        let table = read_text(file, TEXT_BYTES_MAX).ok().and_then(|text| text.parse::<toml::Table>().ok());
        table.is_some_and(|table| table.contains_key("station"))
    };
    files.retain(names_station);
    files.into_iter().map(|file| file.strip_prefix(".").map(Path::to_owned).unwrap_or(file)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn existing_configurations_are_named_once_and_other_files_not() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        assert!(among(&[directory.path()]).contains("`equipoise install` creates"));
        std::fs::write(at("station.toml"), "station = \"s\"\n").unwrap();
        std::fs::write(at("Cargo.toml"), "[package]\nname = \"s\"\n").unwrap();
        std::fs::write(at("station.txt"), "station = \"s\"\n").unwrap();
        let expected = format!("name an existing file: {}", at("station.toml").display());
        assert_eq!(among(&[directory.path(), directory.path(), Path::new("/nowhere")]), expected);
        let missing = io::Error::from(ErrorKind::NotFound);
        assert!(remedy(&at("statoin.toml"), &missing).starts_with(&expected));
        assert!(remedy(directory.path(), &missing).starts_with(&expected));
        let denied = io::Error::from(ErrorKind::PermissionDenied);
        assert_eq!(remedy(&at("station.toml"), &denied), "run the command as a user that may read it");
    }
}
