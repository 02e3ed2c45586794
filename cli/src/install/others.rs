//! The additional programs, and the gateways in the configuration.

use std::path::Path;

use equipoise_gateways::StationFile;

use super::{ADMIN_UNITS, CONFIGURATION_FILE, Destination};

/// Programs that are built separately and located in the directory of `equipoise`.
pub const PROGRAMS: [&str; 4] = [
    "equipoise-gateway-opcua",
    "equipoise-gateway-mqtt",
    "equipoise-gateway-zenoh",
    "equipoise-gateway-foxglove",
];

/// Those present in the directory of `program`.
pub(super) fn next_to(program: &Path) -> impl Iterator<Item = &'static str> {
    PROGRAMS.into_iter().filter(|name| program.with_file_name(name).is_file())
}

/// Notes about missing programs. One of an earlier installation remains but may not match this release.
pub(super) fn missing(destination: &Destination, program: &Path) -> Vec<String> {
    let missing = PROGRAMS.into_iter().filter(|name| !program.with_file_name(name).is_file());
    let (present, absent): (Vec<_>, Vec<_>) =
        missing.partition(|name| destination.under_root(&destination.program_named(name)).exists());
    let mut message = Vec::new();
    if !absent.is_empty() {
        message.push(format!(
            "not installed, since not next to {}: {}; if you need one: cargo build --release -p NAME, and install again",
            program.display(),
            absent.join(", ")
        ));
    }
    for name in present {
        message.push(format!(
            "note: {} stays, since there is no newer one next to {}; all on one bus must be of one release: cargo build \
             --release -p {name}, and install again",
            destination.program_named(name).display(),
            program.display()
        ));
    }
    message
}

/// Instructions for each configured gateway that is not enabled yet.
pub(super) fn configured(destination: &Destination) -> Vec<String> {
    let file = match StationFile::read(&destination.under_root(Path::new(CONFIGURATION_FILE))) {
        Ok(file) => file,
        Err(reason) => return vec![format!("note: gateways were not checked: {reason}")],
    };
    let wants = Path::new(ADMIN_UNITS).join("equipoise.service.wants");
    let mut message = Vec::new();
    for (kind, _) in file.gateways.addresses() {
        let (unit, program) = (format!("equipoise-gateway@{kind}"), format!("equipoise-gateway-{kind}"));
        let needs_program = PROGRAMS.contains(&program.as_str());
        if needs_program && !destination.under_root(&destination.program_named(&program)).is_file() {
            message.push(format!("[gateways.{kind}] needs {program}, which is not installed: see above"));
        } else if !destination.under_root(&wants.join(format!("{unit}.service"))).is_symlink() {
            message.push(format!("[gateways.{kind}] is configured: systemctl enable --now {unit}"));
        }
    }
    message
}
