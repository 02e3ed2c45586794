//! Links that enable units, including manually created ones.

use std::path::{Component, Path, PathBuf};

use super::{ADMIN_UNITS, Destination};

/// The links to units for which `is_ours` returns true, including adapters'; paths on the running system.
pub(super) fn to(destination: &Destination, is_ours: impl Fn(&Path) -> bool) -> Vec<PathBuf> {
    let admin = Path::new(ADMIN_UNITS);
    let mut links = Vec::new();
    for folder in std::fs::read_dir(destination.under_root(admin)).into_iter().flatten().flatten() {
        let name = folder.file_name();
        if !name.to_string_lossy().ends_with(".wants") {
            continue;
        }
        for link in std::fs::read_dir(folder.path()).into_iter().flatten().flatten() {
            let path = admin.join(&name).join(link.file_name());
            if std::fs::read_link(link.path()).is_ok_and(|target| is_ours(&absolute_target(&path, &target))) {
                links.push(path);
            }
        }
    }
    links.sort();
    links
}

/// Absolute path of a link's target.
fn absolute_target(link: &Path, target: &Path) -> PathBuf {
    let mut path = PathBuf::new();
    for part in link.parent().unwrap_or(link).join(target).components() {
        match part {
            Component::ParentDir => drop(path.pop()),
            Component::CurDir => {}
            part => path.push(part),
        }
    }
    path
}
