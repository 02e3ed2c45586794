//! The additional programs, and the outlets in the configuration.

use std::path::Path;

use equipoise_outlets::StationFile;

use super::{ADMIN_UNITS, CONFIGURATION_FILE, Place};

/// Programs that are built separately and located in the directory of `equipoise`.
pub const PROGRAMS: [&str; 5] = [
    "equipoise-outlet-opcua",
    "equipoise-outlet-mqtt",
    "equipoise-outlet-zenoh",
    "equipoise-outlet-foxglove",
    "equipoise-export",
];

/// Those present in the directory of `program`.
pub(super) fn next_to(program: &Path) -> impl Iterator<Item = &'static str> {
    PROGRAMS.into_iter().filter(|name| program.with_file_name(name).is_file())
}

/// Notes about missing programs. One of an earlier installation remains but may not match this release.
pub(super) fn missing(place: &Place, program: &Path) -> Vec<String> {
    let missing = PROGRAMS.into_iter().filter(|name| !program.with_file_name(name).is_file());
    let (kept, absent): (Vec<_>, Vec<_>) =
        missing.partition(|name| place.under_root(&place.other_program(name)).exists());
    let mut said = Vec::new();
    if !absent.is_empty() {
        said.push(format!(
            "not installed, since not next to {}: {}; if you need one: cargo build --release -p NAME, and install again",
            program.display(),
            absent.join(", ")
        ));
    }
    for name in kept {
        said.push(format!(
            "note: {} stays, since there is no newer one next to {}; all on one bus must be of one release: cargo build \
             --release -p {name}, and install again",
            place.other_program(name).display(),
            program.display()
        ));
    }
    said
}

/// Instructions for each configured outlet that is not enabled yet.
pub(super) fn configured(place: &Place) -> Vec<String> {
    let file = match StationFile::read(&place.under_root(Path::new(CONFIGURATION_FILE))) {
        Ok(file) => file,
        Err(why) => return vec![format!("note: outlets were not looked for: {why}")],
    };
    let wants = Path::new(ADMIN_UNITS).join("equipoise.service.wants");
    let mut said = Vec::new();
    for kind in file.outlets.kinds() {
        let (unit, program) = (format!("equipoise-outlet@{kind}"), format!("equipoise-outlet-{kind}"));
        let needs_program = PROGRAMS.contains(&program.as_str());
        if needs_program && !place.under_root(&place.other_program(&program)).is_file() {
            said.push(format!("[outlets.{kind}] needs {program}, which is not installed: see above"));
        } else if !place.under_root(&wants.join(format!("{unit}.service"))).is_symlink() {
            said.push(format!("[outlets.{kind}] is configured: systemctl enable --now {unit}"));
        }
    }
    said
}
