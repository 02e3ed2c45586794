//! Identifies the bus directory that was joined. A directory that is removed and created again is another bus under the
//! same name, and processes that joined the first one receive nothing from it.

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The directory of a bus at the time of joining.
#[derive(Debug)]
pub struct BusDirectory {
    root: PathBuf,
    directory: Option<[u64; 2]>,
}

impl BusDirectory {
    /// Records the current directory.
    pub fn read(root: &Path) -> BusDirectory {
        BusDirectory { root: root.to_owned(), directory: device_and_inode(root) }
    }

    /// Whether the directory was removed or replaced.
    pub fn is_replaced(&self) -> bool {
        device_and_inode(&self.root) != self.directory
    }
}

/// Device and inode number.
fn device_and_inode(directory: &Path) -> Option<[u64; 2]> {
    std::fs::metadata(directory).ok().map(|found| [found.dev(), found.ino()])
}
