//! The bytes of a recording: a file that is read in pieces, so that a whole shift needs no more memory than one chunk,
//! or a copy in memory.

use std::borrow::Cow;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

use equipoise_files::{Links, open_regular_by};

use super::frame::{RECORD_BYTES_MAX, RECORD_HEAD_BYTES, record_end};

/// Storage of a recording's bytes.
#[derive(Debug)]
pub(super) enum Store {
    /// A file, and its length on opening: it may still be growing.
    File(File, usize),
    /// A copy in memory.
    Memory(Vec<u8>),
}

impl Store {
    pub(super) fn open(path: &Path) -> io::Result<Store> {
        let (file, metadata) = open_regular_by(path, Links::Follow)?;
        let length = usize::try_from(metadata.len()).map_err(|_| io::ErrorKind::FileTooLarge)?;
        Ok(Store::File(file, length))
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Store::File(_, length) => *length,
            Store::Memory(bytes) => bytes.len(),
        }
    }

    /// The bytes of a range within the recording.
    pub(super) fn read(&self, range: Range<usize>) -> io::Result<Cow<'_, [u8]>> {
        match self {
            Store::File(file, _) => {
                // Checked before the allocation, as a file may declare any length.
                if range.len() > RECORD_HEAD_BYTES + RECORD_BYTES_MAX {
                    let sentence = format!("a record of {} bytes at byte {}", range.len(), range.start);
                    return Err(io::Error::new(io::ErrorKind::InvalidData, sentence));
                }
                let mut bytes = vec![0; range.len()];
                file.read_exact_at(&mut bytes, range.start as u64)?;
                Ok(Cow::Owned(bytes))
            }
            Store::Memory(bytes) => {
                bytes.get(range).map(Cow::Borrowed).ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
            }
        }
    }

    /// The record at `at` with its opcode; `None` if it is incomplete.
    pub(super) fn record_at(&self, at: usize) -> io::Result<Option<(u8, Range<usize>)>> {
        let head_end = at.saturating_add(RECORD_HEAD_BYTES);
        if head_end > self.len() {
            return Ok(None);
        }
        let head = self.read(at..head_end)?;
        let Some(head) = head.first_chunk::<RECORD_HEAD_BYTES>() else { return Ok(None) };
        let end = record_end(at, head).filter(|end| *end <= self.len());
        Ok(end.map(|end| (head[0], at..end)))
    }
}
