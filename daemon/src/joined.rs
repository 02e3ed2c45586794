//! Which directory of the bus was joined. Whoever removes it and makes it anew has another bus under the same name, and is
//! not heard by those who have joined the first.

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The directory that a bus lay in when it was joined.
#[derive(Debug)]
pub(crate) struct Joined {
    root: PathBuf,
    directory: Option<[u64; 2]>,
}

impl Joined {
    /// Notes the directory as it is now.
    pub(crate) fn now(root: &Path) -> Joined {
        Joined { root: root.to_owned(), directory: numbers(root) }
    }

    /// Whether another directory stands there by now, or none.
    pub(crate) fn is_cut_off(&self) -> bool {
        numbers(&self.root) != self.directory
    }
}

/// Device and number, as the file system counts them.
fn numbers(directory: &Path) -> Option<[u64; 2]> {
    std::fs::metadata(directory).ok().map(|found| [found.dev(), found.ino()])
}
