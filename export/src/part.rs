//! A temporary file that replaces the result once it is complete.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use anyhow::Context;

/// Same mode as recordings: a table contains personal motion data, so other users of the machine have no access.
const FILE_MODE: u32 = 0o640;

/// A temporary file of this process; removed when dropped, unless it replaced the result.
#[derive(Debug)]
pub(super) struct Part {
    path: PathBuf,
    file: File,
}

impl Part {
    /// Creates the file next to the result: the result's name, the process ID, `.part`.
    pub(super) fn next_to(out: &Path) -> anyhow::Result<Part> {
        let mut name: OsString = out.as_os_str().to_owned();
        name.push(format!(".{}.part", std::process::id()));
        let path = PathBuf::from(name);
        let file = OpenOptions::new().write(true).create_new(true).mode(FILE_MODE).open(&path);
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Part { path, file })
    }

    /// A handle for writing.
    pub(super) fn file(&self) -> anyhow::Result<File> {
        self.file.try_clone().with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Renames the complete file to `out`, replacing any existing file.
    pub(super) fn take_place(self, out: &Path) -> anyhow::Result<()> {
        fs::rename(&self.path, out).with_context(|| format!("cannot write {}", out.display()))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // Removes an incomplete table. After a rename this name no longer exists.
        let _ = fs::remove_file(&self.path);
    }
}
