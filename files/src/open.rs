//! Opening regular files only.

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
    let refused = |what: &str| io::Error::new(io::ErrorKind::InvalidInput, what.to_owned());
    let mut flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC;
    if links == Links::Refuse {
        flags |= OFlags::NOFOLLOW;
    }
    let file = match rustix::fs::open(path, flags, Mode::empty()) {
        Ok(file) => File::from(file),
        Err(Errno::LOOP) if links == Links::Refuse => return Err(refused("it is a symbolic link")),
        Err(errno) => return Err(errno.into()),
    };
    // Check the opened file instead of the path, which may refer to another file by now.
    let facts = file.metadata()?;
    match facts.is_file() {
        true => Ok((file, facts)),
        false if facts.is_dir() => Err(refused("it is a folder")),
        false => Err(refused("it is no regular file, but a pipe, a socket or a device")),
    }
}

/// Opens a regular file for reading and follows links.
///
/// # Errors
/// As [`open_regular_by`].
pub fn open_regular(path: &Path) -> io::Result<File> {
    open_regular_by(path, Links::Follow).map(|(file, _)| file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_regular_file_is_opened_and_nothing_waits() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("file"), "a").unwrap();
        std::os::unix::fs::symlink(at("file"), at("link")).unwrap();
        // Without O_NONBLOCK this open would wait for a writer.
        rustix::fs::mknodat(rustix::fs::CWD, at("pipe"), rustix::fs::FileType::Fifo, Mode::RUSR, 0).unwrap();
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
    }
}
