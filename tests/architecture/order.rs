//! The order of dependency: of the crates, and of the core's modules.

use super::source::crates;
use super::{MAY_USE, name_of};

/// The core's modules in the order of dependency: each uses only those of its group and of the groups before it.
const MODULES: [&[&str]; 14] = [
    &["math"],
    &["body", "frame"],
    &["time"],
    &["message"],
    &["effect"],
    &["motion"],
    &["sesc"],
    &["kalman"],
    &["anchor"],
    &["registration"],
    &["static_pose"],
    &["pose_suggestion", "overload"],
    &["handover", "exposure"],
    &["cycle"],
];

#[test]
fn crates_use_only_crates_above_them_in_the_list() {
    for (index, (folder, allowed)) in MAY_USE.iter().enumerate() {
        for dependency in *allowed {
            let before = MAY_USE[..index].iter().any(|(folder, _)| name_of(folder) == *dependency);
            assert!(before, "{folder} may use {dependency}, which is not above it");
        }
    }
}

#[test]
fn core_modules_use_only_those_before_them() {
    let core = crates().find(|found| found.folder == "core").expect("a core");
    let group = |module: &str| MODULES.iter().position(|group| group.contains(&module));
    let mut files = 0;
    for file in core.sources() {
        let path = file.path.to_string_lossy().into_owned();
        let Some(module) = path.strip_prefix("core/src/") else { continue };
        let module = module.split(['/', '.']).next().unwrap_or_default();
        if module == "lib" || path.contains("/tests") {
            continue;
        }
        let own = group(module).unwrap_or_else(|| panic!("{module} is missing in MODULES"));
        let code = file.code.split("mod tests {").next().unwrap_or_default();
        for used in file.with_code(code).used_modules("crate") {
            if let Some(used_group) = group(&used) {
                assert!(used_group <= own, "{path} uses {used}, which is a later module");
            }
        }
        files += 1;
    }
    assert!(files > 100, "{files} files");
}
