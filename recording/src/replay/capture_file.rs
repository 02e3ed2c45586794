//! File of another program, read from its beginning by each pass.

use std::fs::File;
use std::io::{self, Seek};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::Context;
use equipoise_files::open_regular;

/// A capture, and the position of the newest pass.
#[derive(Debug)]
pub struct CaptureFile {
    path: PathBuf,
    /// A duplicate of the newest pass's descriptor, which shares its position.
    newest: Mutex<Option<File>>,
}

impl CaptureFile {
    pub(super) fn new(path: &Path) -> CaptureFile {
        CaptureFile { path: path.to_owned(), newest: Mutex::default() }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Opens the file for another pass.
    pub(super) fn open(&self) -> anyhow::Result<File> {
        let open = || -> io::Result<File> {
            let file = open_regular(&self.path)?;
            *self.newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(file.try_clone()?);
            Ok(file)
        };
        open().with_context(|| format!("cannot read {}", self.path.display()))
    }

    /// Fraction of the file that the newest pass has read; 0 before the first one.
    pub(super) fn fraction_read(&self) -> f64 {
        let newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        let fraction = |mut file: &File| -> io::Result<f64> {
            Ok(file.stream_position()? as f64 / file.metadata()?.len().max(1) as f64)
        };
        newest.as_ref().and_then(|file| fraction(file).ok()).unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    #[test]
    fn the_fraction_is_that_of_the_newest_pass() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.csv");
        std::fs::write(&path, [0; 100]).unwrap();
        let capture = CaptureFile::new(&path);
        assert_eq!(capture.fraction_read(), 0.0);
        let mut first = capture.open().unwrap();
        first.read_exact(&mut [0; 25]).unwrap();
        assert_eq!(capture.fraction_read(), 0.25);
        let mut second = capture.open().unwrap();
        first.read_exact(&mut [0; 25]).unwrap();
        assert_eq!(capture.fraction_read(), 0.0);
        second.read_exact(&mut [0; 100]).unwrap();
        assert_eq!(capture.fraction_read(), 1.0);
    }
}
