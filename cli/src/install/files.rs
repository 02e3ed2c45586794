//! Atomic installation of files with given permissions, independent of the umask.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt, symlink};
use std::path::Path;

use anyhow::Context;

/// Result of installing a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum InstallResult {
    /// The file did not exist or differed.
    Written,
    /// The file existed with the same content.
    Unchanged,
}

/// Installs a file. A running program is not affected: its old file exists until it ends.
pub(super) fn install_file(path: &Path, content: &[u8], mode: u32) -> anyhow::Result<InstallResult> {
    let is_unchanged = |found: fs::Metadata| found.is_file() && found.permissions().mode() & 0o7777 == mode;
    let existing = fs::symlink_metadata(path).is_ok_and(is_unchanged)
        && fs::read(path).is_ok_and(|existing| existing == content);
    if existing {
        return Ok(InstallResult::Unchanged);
    }
    let written = (|| {
        let folder = path.parent().unwrap_or(Path::new("/"));
        make_folder(folder)?;
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let part = Path::new(&part);
        // Leftover of an interrupted attempt, or a link planted to redirect the write.
        match fs::remove_file(part) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        write_new(part, content, mode)
            .and_then(|()| fs::rename(part, path))
            .inspect_err(|_| drop(fs::remove_file(part)))?;
        File::open(folder)?.sync_all()
    })();
    written.with_context(|| refused("write", path))?;
    Ok(InstallResult::Written)
}

/// Creates a new file; it is on disk at the return.
fn write_new(path: &Path, content: &[u8], mode: u32) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
    file.write_all(content)?;
    file.set_permissions(Permissions::from_mode(mode))?;
    file.sync_all()
}

/// Creates the link `link` to `target`, replacing an existing link.
pub(super) fn link(link: &Path, target: &Path) -> anyhow::Result<()> {
    if fs::read_link(link).is_ok_and(|existing| existing == target) {
        return Ok(());
    }
    let linked = (|| {
        make_folder(link.parent().unwrap_or(Path::new("/")))?;
        match fs::remove_file(link) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
            _ => symlink(target, link),
        }
    })();
    linked.with_context(|| refused("link", link))
}

/// Removes a file or link; returns whether it existed.
pub(super) fn remove(path: &Path) -> anyhow::Result<bool> {
    match fs::remove_file(path) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error).with_context(|| refused("remove", path)),
    }
}

fn refused(what: &str, path: &Path) -> String {
    format!("cannot {what} {}; do it as root, or below a folder of yours with --root", path.display())
}

/// Creates missing folders world-readable, like the system's.
fn make_folder(folder: &Path) -> io::Result<()> {
    if folder.is_dir() {
        return Ok(());
    }
    if let Some(parent) = folder.parent() {
        make_folder(parent)?;
    }
    match fs::create_dir(folder) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(error),
        _ => fs::set_permissions(folder, Permissions::from_mode(0o755)),
    }
}
