//! A file whose SHA-256 is computed during writing, so that it need not be read again.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

use equipoise_files::Sha256;

/// A file that is written sequentially.
#[derive(Debug)]
pub struct HashedFile {
    file: File,
    hash: Sha256,
}

impl HashedFile {
    /// Starts at the beginning of an empty file.
    pub(super) fn new(file: File) -> HashedFile {
        HashedFile { file, hash: Sha256::default() }
    }

    /// The file, and the SHA-256 of its bytes, 64 hexadecimal digits.
    pub(super) fn finish(self) -> (File, String) {
        (self.file, self.hash.finish())
    }
}

impl Write for HashedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.hash.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// The position can be queried, not changed: the hash is of the bytes in the order of writing.
impl Seek for HashedFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        match position {
            SeekFrom::Current(0) => self.file.stream_position(),
            _ => Err(io::Error::from(io::ErrorKind::Unsupported)),
        }
    }
}
