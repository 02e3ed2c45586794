//! Transport from a file that another program writes, or from a named pipe: reads what is appended to it.

use super::error::SourceError;
use super::transport::{Incoming, Transport};
use crate::clock::now_monotonic_ns;
use rustix::fs::OFlags;
use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Polling interval of a file without new data; upper bound of the added latency.
const PAUSE: Duration = Duration::from_millis(5);
/// Size of one read; a stream may arrive in pieces of any size.
const BUFFER_SIZE: usize = 65_536;

/// Start position of reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Begin {
    /// With what is appended from now on, as far as the file has an end: a pipe has none.
    #[default]
    End,
    /// With the first line.
    Start,
}

/// A file or named pipe that is followed.
#[derive(Debug)]
pub struct FileLine {
    path: PathBuf,
    begin: Begin,
    key: &'static str,
    /// Kept open until the next file is open, so that no other file can obtain its inode meanwhile.
    open: Option<Open>,
    /// The file did not exist at the first attempt to open it: all of its later contents are new.
    missed: bool,
    goes_on: bool,
    begins_at_start: bool,
    buffer: Box<[u8]>,
}

#[derive(Debug)]
struct Open {
    file: File,
    is_pipe: bool,
    /// Device and inode.
    identity: (u64, u64),
    read: u64,
    /// Another file has replaced it, or it was truncated.
    is_over: bool,
}

fn identity(metadata: &Metadata) -> (u64, u64) {
    (metadata.dev(), metadata.ino())
}

impl FileLine {
    /// Follows the file at a path; `key` is its configuration key for errors.
    pub fn new(path: PathBuf, begin: Begin, key: &'static str) -> FileLine {
        let buffer = vec![0; BUFFER_SIZE].into_boxed_slice();
        FileLine {
            path,
            begin,
            key,
            open: None,
            missed: false,
            goes_on: false,
            begins_at_start: false,
            buffer,
        }
    }

    /// Start position in a file that was just opened, and whether it continues where the last one ended.
    ///
    /// No data are read twice: after a temporary failure of a network share, hours of old data would otherwise count as
    /// fresh. Data appended meanwhile are outdated, and read only with [`Begin::Start`].
    fn where_from(&self, metadata: &Metadata) -> (u64, bool) {
        let same = |before: &&Open| {
            !before.is_over && before.identity == identity(metadata) && before.read <= metadata.len()
        };
        match (&self.open, self.begin) {
            (Some(before), Begin::Start) if same(&before) => (before.read, true),
            (Some(before), Begin::End) if same(&before) => (metadata.len(), false),
            (None, Begin::End) if !self.missed => (metadata.len(), false),
            // A file that replaced the previous one, or did not exist before, is new from its first byte on.
            _ => (0, false),
        }
    }

    fn absent(&self, error: io::Error) -> SourceError {
        SourceError::Absent {
            what: format!("the file {}", self.path.display()),
            remedy: format!("start the program that writes it, or set {}", self.key),
            error,
        }
    }

    /// Converts a failure to open a file.
    fn refused(&self, error: io::Error) -> SourceError {
        match error.kind() {
            ErrorKind::PermissionDenied => SourceError::Unready {
                what: format!("the file {}", self.path.display()),
                why: error.to_string(),
                remedy: format!("give this user the right to read it, or set {}", self.key),
            },
            _ => self.absent(error),
        }
    }
}

/// Whether the path refers to another file now, or the file was truncated.
fn is_replaced(open: &Open, path: &Path) -> io::Result<bool> {
    let held = open.file.metadata()?;
    Ok(held.len() < open.read || identity(&std::fs::metadata(path)?) != open.identity)
}

impl Transport for FileLine {
    fn open(&mut self) -> Result<(), SourceError> {
        // Opening a pipe must not block until a writer exists.
        let opened = OpenOptions::new()
            .read(true)
            .custom_flags(OFlags::NONBLOCK.bits().cast_signed())
            .open(&self.path);
        let mut file = opened.map_err(|error| {
            self.missed |= error.kind() == ErrorKind::NotFound;
            self.refused(error)
        })?;
        let metadata = file.metadata().map_err(|error| self.refused(error))?;
        let kind = metadata.file_type();
        if !kind.is_file() && !kind.is_fifo() {
            let what = format!("{}: {} is neither a file nor a pipe", self.key, self.path.display());
            return Err(SourceError::Unusable(what));
        }
        let is_pipe = kind.is_fifo();
        let (read, goes_on) = if is_pipe { (0, false) } else { self.where_from(&metadata) };
        if !is_pipe {
            file.seek(SeekFrom::Start(read)).map_err(|error| self.refused(error))?;
        }
        self.goes_on = goes_on;
        // A pipe may have been opened in the middle of a line.
        self.begins_at_start = !is_pipe && read == 0;
        self.open = Some(Open { file, is_pipe, identity: identity(&metadata), read, is_over: false });
        Ok(())
    }

    fn goes_on(&self) -> bool {
        self.goes_on
    }

    fn begins_at_start(&self) -> bool {
        self.begins_at_start
    }

    fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError> {
        let Some(open) = &mut self.open else {
            return Err(SourceError::Unusable(format!("{}: used before it was opened", self.key)));
        };
        let was_read = open.read > 0;
        let read = match open.file.read(&mut self.buffer) {
            Ok(read) => read,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                std::thread::sleep(PAUSE);
                return Ok(None);
            }
            Err(error) => return Err(self.absent(error)),
        };
        let arrival_ns = now_monotonic_ns();
        open.read += read as u64;
        if read > 0 {
            return Ok(Some(Incoming { bytes: &self.buffer[..read], arrival_ns, admitted: true }));
        }
        let left = if open.is_pipe {
            // A writer that closed the pipe in the middle of a line will not continue it.
            was_read.then_some("no process writes into this pipe any more")
        } else {
            match is_replaced(open, &self.path) {
                Ok(replaced) => {
                    open.is_over = replaced;
                    replaced.then_some("another one stands in its place")
                }
                Err(error) => return Err(self.refused(error)),
            }
        };
        if let Some(left) = left {
            return Err(self.absent(io::Error::new(ErrorKind::UnexpectedEof, left)));
        }
        std::thread::sleep(PAUSE);
        Ok(None)
    }

    fn send(&mut self, _bytes: &[u8]) -> Result<(), SourceError> {
        Err(SourceError::Unusable(format!("{}: a file takes no commands", self.key)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    use std::io::Write;
    use std::time::Instant;

    fn text_within_a_while(line: &mut FileLine, want: usize) -> String {
        let mut text = Vec::new();
        let until = Instant::now() + Duration::from_secs(10);
        while text.len() < want && Instant::now() < until {
            match line.receive() {
                Ok(Some(incoming)) => text.extend_from_slice(incoming.bytes),
                Ok(None) => {}
                Err(error) => panic!("{error}"),
            }
        }
        String::from_utf8(text).unwrap()
    }

    fn error_within_a_while(line: &mut FileLine) -> SourceError {
        let until = Instant::now() + Duration::from_secs(10);
        while Instant::now() < until {
            if let Err(error) = line.receive() {
                return error;
            }
        }
        panic!("nothing was wrong");
    }

    fn append(path: &Path, text: &str) {
        OpenOptions::new().append(true).create(true).open(path).unwrap().write_all(text.as_bytes()).unwrap();
    }

    #[test]
    fn a_growing_file_is_followed_from_its_end_or_its_start() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("export.txt");
        append(&path, "old\n");
        let mut from_end = FileLine::new(path.clone(), Begin::End, "ground.file.path");
        let mut from_start = FileLine::new(path.clone(), Begin::Start, "ground.file.path");
        from_end.open().unwrap();
        from_start.open().unwrap();
        append(&path, "new\n");
        assert_eq!(text_within_a_while(&mut from_end, 4), "new\n");
        assert_eq!(text_within_a_while(&mut from_start, 8), "old\nnew\n");
    }

    #[test]
    fn a_late_or_truncated_file_is_read_from_its_start() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("export.txt");
        let mut line = FileLine::new(path.clone(), Begin::End, "ground.file.path");
        let said = line.open().unwrap_err();
        assert!(said.may_recover() && said.to_string().contains("ground.file.path"), "{said}");
        append(&path, "first\n");
        line.open().unwrap();
        assert_eq!(text_within_a_while(&mut line, 6), "first\n");
        std::fs::write(&path, "x\n").unwrap();
        assert!(error_within_a_while(&mut line).may_recover());
        line.open().unwrap();
        assert_eq!(text_within_a_while(&mut line, 2), "x\n");
        std::fs::remove_file(&path).unwrap();
        append(&path, "another\n");
        assert!(error_within_a_while(&mut line).may_recover());
        line.open().unwrap();
        assert_eq!(text_within_a_while(&mut line, 8), "another\n");
        // A file that is absent for longer than one attempt.
        std::fs::remove_file(&path).unwrap();
        assert!(error_within_a_while(&mut line).may_recover());
        assert!(line.open().unwrap_err().may_recover());
        append(&path, "and yet another\n");
        line.open().unwrap();
        assert_eq!(text_within_a_while(&mut line, 16), "and yet another\n");
        // A file that was truncated and is longer than before when it is opened again.
        std::fs::write(&path, "y\n").unwrap();
        assert!(error_within_a_while(&mut line).may_recover());
        append(&path, "more than there was before\n");
        line.open().unwrap();
        assert_eq!(text_within_a_while(&mut line, 29), "y\nmore than there was before\n");
    }

    #[test]
    fn a_file_that_could_not_be_read_for_a_moment_is_never_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("export.txt");
        append(&path, "old\n");
        let mut lines =
            [Begin::End, Begin::Start].map(|begin| FileLine::new(path.clone(), begin, "ground.file.path"));
        lines.iter_mut().for_each(|line| line.open().unwrap());
        append(&path, "one\n");
        let [from_end, from_start] = &mut lines;
        assert_eq!(text_within_a_while(from_end, 4), "one\n");
        assert_eq!(text_within_a_while(from_start, 8), "old\none\n");
        append(&path, "meanwhile\n");
        // As an engine does after an error.
        from_end.open().unwrap();
        from_start.open().unwrap();
        assert!(!from_end.goes_on() && from_start.goes_on());
        append(&path, "two\n");
        assert_eq!(text_within_a_while(from_end, 4), "two\n", "what came meanwhile is old by now");
        assert_eq!(text_within_a_while(from_start, 14), "meanwhile\ntwo\n");
    }

    #[test]
    fn a_pipe_waits_for_its_writer_and_outlives_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pipe");
        mknodat(CWD, &path, FileType::Fifo, Mode::RWXU, 0).unwrap();
        let mut line = FileLine::new(path.clone(), Begin::Start, "ground.file.path");
        line.open().unwrap();
        assert!(line.receive().unwrap().is_none());
        for text in ["one\n", "two\n"] {
            let mut writer = OpenOptions::new().write(true).open(&path).unwrap();
            writer.write_all(text.as_bytes()).unwrap();
            assert_eq!(text_within_a_while(&mut line, 4), text);
            drop(writer);
            assert!(error_within_a_while(&mut line).may_recover());
            line.open().unwrap();
        }
        let folder = FileLine::new(folder.path().to_owned(), Begin::Start, "ground.file.path").open();
        assert!(matches!(folder, Err(SourceError::Unusable(_))), "{folder:?}");
    }
}
