//! Opening regular files only, for reading and for writing.

use std::fs::{File, Metadata};
use std::io;
use std::path::Path;

use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;

/// How to treat a symbolic link at the end of the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Links {
    /// Open the target.
    Follow,
    /// Reject it.
    Refuse,
}

/// Opens a regular file for reading and returns it with its metadata.
///
/// # Errors
/// Errors of the system; for a folder, pipe, socket or device, and with [`Links::Refuse`] for a link,
/// [`io::ErrorKind::InvalidInput`] with the kind of the file. Never blocks: a pipe without a writer is rejected at
/// once.
pub fn open_regular_by(path: &Path, links: Links) -> io::Result<(File, Metadata)> {
    let mut flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC;
    if links == Links::Refuse {
        flags |= OFlags::NOFOLLOW;
    }
    let file = match rustix::fs::open(path, flags, Mode::empty()) {
        Ok(file) => File::from(file),
        Err(Errno::LOOP) if links == Links::Refuse => return Err(refused("it is a symbolic link")),
        Err(errno) => return Err(errno.into()),
    };
    let facts = regular(&file)?;
    Ok((file, facts))
}

/// Checks the opened file instead of the path, which may refer to another file by now.
fn regular(file: &File) -> io::Result<Metadata> {
    let facts = file.metadata()?;
    match facts.is_file() {
        true => Ok(facts),
        false if facts.is_dir() => Err(refused("it is a folder")),
        false => Err(refused("it is no regular file, but a pipe, a socket or a device")),
    }
}

fn refused(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, what.to_owned())
}

/// Opens a regular file for reading and follows links.
///
/// # Errors
/// As [`open_regular_by`].
pub fn open_regular(path: &Path) -> io::Result<File> {
    open_regular_by(path, Links::Follow).map(|(file, _)| file)
}

/// Treatment of an existing file that is opened for writing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Its content stays and is overwritten from the start.
    Keep,
    /// Every write is appended to its content.
    Append,
    /// Its content is removed.
    Truncate,
}

/// Opens a regular file for reading and writing and follows links; creates it with this mode if it does not exist.
///
/// # Errors
/// As [`open_regular_by`]; a pipe without a reader is rejected at once, too.
pub fn write_regular(path: &Path, existing: Existing, mode: u32) -> io::Result<File> {
    let mut flags = OFlags::RDWR | OFlags::CREATE | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC;
    if existing == Existing::Append {
        flags |= OFlags::APPEND;
    }
    let file = File::from(rustix::fs::open(path, flags, Mode::from_raw_mode(mode))?);
    regular(&file)?;
    if existing == Existing::Truncate {
        file.set_len(0)?;
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn only_a_regular_file_is_opened_and_nothing_waits() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("file"), "a").unwrap();
        std::os::unix::fs::symlink(at("file"), at("link")).unwrap();
        // Without O_NONBLOCK this open would wait for a writer.
        rustix::fs::mknodat(
            rustix::fs::CWD,
            at("pipe"),
            rustix::fs::FileType::Fifo,
            Mode::RUSR | Mode::WUSR,
            0,
        )
        .unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        assert!(open_regular(&at("file")).is_ok() && open_regular(&at("link")).is_ok());
        assert!(open_regular_by(&at("file"), Links::Refuse).is_ok());
        let said = |path: &Path, links| open_regular_by(path, links).unwrap_err().to_string();
        assert_eq!(said(&at("link"), Links::Refuse), "it is a symbolic link");
        for links in [Links::Follow, Links::Refuse] {
            assert_eq!(said(folder.path(), links), "it is a folder");
            assert!(said(&at("pipe"), links).contains("pipe"));
            assert!(said(Path::new("/dev/zero"), links).contains("device"));
        }
        assert!(open_regular(&at("socket")).is_err());
        assert_eq!(open_regular(&at("none")).unwrap_err().kind(), io::ErrorKind::NotFound);
        for existing in [Existing::Keep, Existing::Append, Existing::Truncate] {
            let refusal = |path: &Path| write_regular(path, existing, 0o600).unwrap_err().to_string();
            assert!(refusal(&at("pipe")).contains("pipe"));
            assert!(refusal(Path::new("/dev/zero")).contains("device"));
            assert!(write_regular(folder.path(), existing, 0o600).is_err());
            assert!(write_regular(&at("socket"), existing, 0o600).is_err());
        }
    }

    #[test]
    fn a_written_file_is_created_kept_appended_to_or_truncated() {
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("a"), folder.path().join("link"));
        std::os::unix::fs::symlink(&path, &link).unwrap();
        for (existing, expected) in [
            (Existing::Append, "one"),
            (Existing::Append, "oneone"),
            (Existing::Keep, "oneone"),
            (Existing::Truncate, "one"),
        ] {
            write_regular(&link, existing, 0o600).unwrap().write_all(b"one").unwrap();
            assert_eq!(std::fs::read_to_string(&path).unwrap(), expected, "{existing:?}");
        }
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
    }
}
