//! Files put in place whole, with the permissions asked for whatever the umask is.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt, symlink};
use std::path::Path;

use anyhow::Context;

/// What became of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Put {
    /// It was not there, or was another.
    Written,
    /// It was there already.
    Unchanged,
}

/// Puts a file in place. A program that runs from there goes on running: the old file stays until it has ended.
pub(super) fn put(path: &Path, content: &[u8], mode: u32) -> anyhow::Result<Put> {
    let is_such = |found: fs::Metadata| found.is_file() && found.permissions().mode() & 0o7777 == mode;
    let there =
        fs::symlink_metadata(path).is_ok_and(is_such) && fs::read(path).is_ok_and(|there| there == content);
    if there {
        return Ok(Put::Unchanged);
    }
    let written = (|| {
        let folder = path.parent().unwrap_or(Path::new("/"));
        make_folder(folder)?;
        let mut beside = path.as_os_str().to_owned();
        beside.push(".part");
        let beside = Path::new(&beside);
        // What an attempt that was killed left there, or whatever somebody has put there to be written through.
        match fs::remove_file(beside) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        write_new(beside, content, mode)
            .and_then(|()| fs::rename(beside, path))
            .inspect_err(|_| drop(fs::remove_file(beside)))?;
        File::open(folder)?.sync_all()
    })();
    written.with_context(|| refused("write", path))?;
    Ok(Put::Written)
}

/// Writes a file that is not there yet; on the disk when this returns.
fn write_new(path: &Path, content: &[u8], mode: u32) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
    file.write_all(content)?;
    file.set_permissions(Permissions::from_mode(mode))?;
    file.sync_all()
}

/// Links `link` to `target`, in place of whatever link is there.
pub(super) fn link(link: &Path, target: &Path) -> anyhow::Result<()> {
    if fs::read_link(link).is_ok_and(|there| there == target) {
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

/// Removes a file or link; whether there was one.
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

/// Folders that are missing are made readable for everybody, as those of the system are.
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
