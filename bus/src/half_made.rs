//! Removes the remains of a process that was killed while it joined the bus.
//!
//! A node consists of a directory that contains its details, and three files next to it, created in sequence. iceoryx2
//! searches for dead nodes among the last of these files, so it does not find a process killed before that one exists.
//! A process killed while a port or a service is being registered in the directory leaves a partial file there;
//! iceoryx2 then removes everything else, the details last, and fails at the directory on each attempt. Both kinds of
//! remains would stay for ever.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Ending of the file in the directory that is created first and removed last.
const DETAILS: &str = "node.details";
/// Endings of the three files.
const FILES: [&str; 3] = [".node_monitor", ".node_monitor_context", ".node_monitor_owner_lock"];
/// Joining takes milliseconds; files that have not changed for this long are not being created any more.
const GIVEN_UP: Duration = Duration::from_secs(5);

/// Removes the incomplete nodes under `nodes`, whose files begin with `prefix`; returns their number.
pub(crate) fn remove(nodes: &Path, prefix: &str) -> usize {
    ids(nodes, prefix).into_iter().filter(|id| remove_if_half_made(nodes, prefix, id)).count()
}

fn ids(nodes: &Path, prefix: &str) -> BTreeSet<String> {
    let names = fs::read_dir(nodes).into_iter().flatten().flatten().map(|entry| entry.file_name());
    names
        .filter_map(|name| {
            let name = name.to_str()?;
            let file = name.strip_prefix(prefix).and_then(|name| name.split_once('.'));
            let id = file.map_or(name, |(id, _)| id);
            id.bytes().all(|byte| byte.is_ascii_digit()).then(|| id.to_owned())
        })
        .collect()
}

fn remove_if_half_made(nodes: &Path, prefix: &str, id: &str) -> bool {
    let directory = nodes.join(id);
    let files: Vec<PathBuf> = FILES.iter().map(|end| nodes.join(format!("{prefix}{id}{end}"))).collect();
    let all = || files.iter().chain([&directory]);
    let is_whole = all().all(|path| path.exists()) && directory.join(format!("{prefix}{DETAILS}")).exists();
    if is_whole || !all().filter(|path| path.exists()).all(|path| has_stood_still(path)) {
        return false;
    }
    // If a removal fails, the next call tries again.
    let _ = fs::remove_dir_all(&directory);
    files.iter().for_each(|file| drop(fs::remove_file(file)));
    !all().any(|path| path.exists())
}

fn has_stood_still(path: &Path) -> bool {
    let changed = path.metadata().and_then(|metadata| metadata.modified());
    changed.is_ok_and(|changed| changed.elapsed().is_ok_and(|age| age > GIVEN_UP))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;

    /// Sets the file's time to long before the test.
    fn age(path: &Path) {
        let file = fs::File::open(path).unwrap();
        file.set_modified(SystemTime::now() - 2 * GIVEN_UP).unwrap();
    }

    #[test]
    fn only_what_is_half_made_and_old_goes() {
        let nodes = std::env::temp_dir().join(format!("half-made-{}", std::process::id()));
        let make = |id: &str, files: usize, old: bool| {
            let directory = nodes.join(id);
            fs::create_dir_all(&directory).unwrap();
            fs::write(directory.join("eqp_x_node.details"), "").unwrap();
            let paths = FILES[..files].iter().map(|end| nodes.join(format!("eqp_x_{id}{end}")));
            for path in paths.inspect(|path| fs::write(path, "").unwrap()).chain([directory.clone()]) {
                if old {
                    age(&path);
                }
            }
        };
        make("1", 3, true);
        make("2", 0, true);
        make("3", 2, true);
        make("4", 1, false);
        make("5", 3, true);
        fs::rename(nodes.join("5/eqp_x_node.details"), nodes.join("5/eqp_x_7.port_tag")).unwrap();
        assert_eq!(remove(&nodes, "eqp_x_"), 2, "5 has just changed");
        age(&nodes.join("5"));
        assert_eq!(remove(&nodes, "eqp_x_"), 1);
        assert_eq!(remove(&nodes, "eqp_x_"), 0);
        let left: BTreeSet<String> = ids(&nodes, "eqp_x_");
        assert_eq!(left, BTreeSet::from(["1", "4"].map(str::to_owned)));
        fs::remove_dir_all(&nodes).unwrap();
    }
}
