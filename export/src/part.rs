//! A file under a name of its own until it is whole.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use anyhow::Context;

/// As of recordings: a table tells how a person moves, and is not for everyone on the machine.
const FILE_MODE: u32 = 0o640;

/// A file that nobody else has; removed when dropped, unless it took its place.
#[derive(Debug)]
pub(super) struct Part {
    path: PathBuf,
    file: File,
}

impl Part {
    /// Makes one beside the result: its name, the number of this process, `.part`.
    pub(super) fn beside(out: &Path) -> anyhow::Result<Part> {
        let mut name: OsString = out.as_os_str().to_owned();
        name.push(format!(".{}.part", std::process::id()));
        let path = PathBuf::from(name);
        let file = OpenOptions::new().write(true).create_new(true).mode(FILE_MODE).open(&path);
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Part { path, file })
    }

    /// The file, to be written.
    pub(super) fn file(&self) -> anyhow::Result<File> {
        self.file.try_clone().with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// The file is whole: it replaces what has its name.
    pub(super) fn take_place(self, out: &Path) -> anyhow::Result<()> {
        fs::rename(&self.path, out).with_context(|| format!("cannot write {}", out.display()))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // Half a table is none. After it took its place there is nothing under this name.
        let _ = fs::remove_file(&self.path);
    }
}
