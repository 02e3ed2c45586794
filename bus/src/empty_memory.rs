//! Shared memory of size zero: its creator was killed between creating it and setting its size.
//!
//! iceoryx2 polls such memory once per millisecond without a time limit: its time-out
//! (`dynamic_storage/posix_shared_memory.rs` of iceoryx2-cal 0.10.0, `MappingSizeIsZero`) ends every wait except this
//! one. Cleaning up the creator, or opening that connection, would therefore never return. So such memory is removed
//! first, and no dead node is cleaned up while any remains. A process that already waits detects the removal and
//! continues.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Directory in which Linux lists shared memory as files.
pub(crate) const DIRECTORY: &str = "/dev/shm";
/// Age after which the size will not be set any more: creation and sizing are consecutive system calls, but the machine
/// may be busy.
const GIVEN_UP: Duration = Duration::from_secs(2);

/// Whether there is shared memory of size zero whose name begins with `prefix`.
pub(crate) fn is_there(directory: &Path, prefix: &str) -> bool {
    empty(directory, prefix).next().is_some()
}

/// Removes memory of size zero that is older than `GIVEN_UP`.
pub(crate) fn remove(directory: &Path, prefix: &str) {
    for path in empty(directory, prefix).filter(|path| has_stood_still(path)) {
        // If the removal fails, the next call tries again.
        let _ = fs::remove_file(path);
    }
}

fn empty(directory: &Path, prefix: &str) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    let ours =
        entries.filter(move |entry| entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes()));
    ours.filter(|entry| entry.metadata().is_ok_and(|facts| facts.is_file() && facts.len() == 0))
        .map(|entry| entry.path())
}

fn has_stood_still(path: &Path) -> bool {
    let changed = path.metadata().and_then(|facts| facts.modified());
    changed.is_ok_and(|changed| changed.elapsed().is_ok_and(|age| age > GIVEN_UP))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;

    #[test]
    fn only_what_is_ours_and_empty_and_old_goes() {
        let directory = std::env::temp_dir().join(format!("empty-memory-{}", std::process::id()));
        fs::create_dir_all(&directory).unwrap();
        let make = |name: &str, content: &str, old: bool| {
            fs::write(directory.join(name), content).unwrap();
            if old {
                let file = fs::File::options().write(true).open(directory.join(name)).unwrap();
                file.set_modified(SystemTime::now() - 2 * GIVEN_UP).unwrap();
            }
        };
        make("eqp_x_1_2.connection", "whole", true);
        make("other_1_2.connection", "", true);
        assert!(!is_there(&directory, "eqp_x_"));
        make("eqp_x_1_3.connection", "", true);
        make("eqp_x_1_4.connection", "", false);
        remove(&directory, "eqp_x_");
        assert!(is_there(&directory, "eqp_x_"), "the young one may get its size yet");
        let names: Vec<_> =
            fs::read_dir(&directory).unwrap().flatten().map(|entry| entry.file_name()).collect();
        assert_eq!(names.len(), 3, "{names:?}");
        assert!(!names.contains(&"eqp_x_1_3.connection".into()), "{names:?}");
        fs::remove_dir_all(&directory).unwrap();
    }
}
