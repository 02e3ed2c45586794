//! Identifies the bus directory that was joined. A directory that is removed and created again is another bus under the
//! same name, and processes that joined the first one receive nothing from it.

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The directory of a bus at the time of joining.
#[derive(Debug)]
pub(crate) struct Joined {
    root: PathBuf,
    directory: Option<[u64; 2]>,
}

impl Joined {
    /// Records the current directory.
    pub(crate) fn now(root: &Path) -> Joined {
        Joined { root: root.to_owned(), directory: numbers(root) }
    }

    /// Whether the directory was removed or replaced.
    pub(crate) fn is_cut_off(&self) -> bool {
        numbers(&self.root) != self.directory
    }
}

/// Device and inode number.
fn numbers(directory: &Path) -> Option<[u64; 2]> {
    std::fs::metadata(directory).ok().map(|found| [found.dev(), found.ino()])
}
