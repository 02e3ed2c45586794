//! Why a serial port cannot be used, and the remedy; determined when the error occurs, for the operator.

use super::super::error::SourceError;
use super::LineSettings;
use rustix::fs::major;
use rustix::io::Errno;
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Names that are tied to the device, not to the USB socket.
const BY_ID: &str = "/dev/serial/by-id";
/// Name prefixes of serial ports without such a name.
const KINDS: [&str; 4] = ["ttyUSB", "ttyACM", "ttyAMA", "ttyXRUSB"];
/// Maximum count of listed names.
const NAMED_MAX: usize = 8;

/// Converts the system's error of opening or configuring the port.
pub(super) fn refused(settings: &LineSettings, errno: Errno) -> SourceError {
    let port = settings.port.display();
    match errno {
        Errno::BUSY => unready(
            settings,
            holder(&settings.port)
                .map_or_else(|| "another program uses it".to_owned(), |who| format!("{who} uses it")),
            format!("close that (`fuser {port}` names it, as root), or set {} to another port", settings.key),
        ),
        Errno::ACCESS => unready(
            settings,
            "this user may not open it".to_owned(),
            format!(
                "let it into the port's group, {}; a service with SupplementaryGroups=, another user by `usermod -aG` and \
                 a new session",
                group(&settings.port)
            ),
        ),
        Errno::PERM => unready(
            settings,
            "this service may not open it".to_owned(),
            format!(
                "its unit needs `DeviceAllow={} rw` in a drop-in (`systemctl edit equipoise`, systemd/README.md)",
                fs::metadata(&settings.port)
                    .map_or_else(|_| port.to_string(), |port| format!("char-{}", major(port.rdev()))),
            ),
        ),
        Errno::NOTTY => no_port(settings),
        errno => absent(settings, errno.into()),
    }
}

/// The port existed and has disappeared.
pub(super) fn gone(settings: &LineSettings, why: &str) -> SourceError {
    absent(settings, io::Error::new(io::ErrorKind::NotConnected, why.to_owned()))
}

/// The device accepts no more bytes.
pub(super) fn stuck(settings: &LineSettings) -> SourceError {
    let what = "the device takes no bytes".to_owned();
    unready(settings, what, "look at its power and cable, and whether it wants rts_cts as set".to_owned())
}

/// The path is not a serial port.
pub(super) fn no_port(settings: &LineSettings) -> SourceError {
    SourceError::Unusable(format!(
        "{} is no serial port; set {}: {}",
        settings.port.display(),
        settings.key,
        ports_there(Path::new(BY_ID), Path::new("/dev"))
    ))
}

/// The port does not support the speed.
pub(super) fn wrong_speed(settings: &LineSettings, baud: u32, is: Option<u32>) -> SourceError {
    let instead = is.map_or_else(String::new, |is| format!(", and took {is} instead"));
    SourceError::Unusable(format!(
        "the serial port {} cannot do {baud} baud{instead}; use another adapter, or another speed of the device",
        settings.port.display()
    ))
}

fn absent(settings: &LineSettings, error: io::Error) -> SourceError {
    let port = &settings.port;
    SourceError::Absent {
        what: format!("the serial port {}", port.display()),
        error,
        remedy: format!(
            "plug it in, or set {}: {}",
            settings.key,
            ports_there(Path::new(BY_ID), Path::new("/dev"))
        ),
    }
}

fn unready(settings: &LineSettings, why: String, remedy: String) -> SourceError {
    SourceError::Unready { what: format!("the serial port {}", settings.port.display()), why, remedy }
}

/// Lists the existing ports.
fn ports_there(by_id: &Path, devices: &Path) -> String {
    let lasting = names(by_id, |_| true);
    let there = if lasting.is_empty() {
        names(devices, |name| KINDS.iter().any(|kind| name.starts_with(kind)))
    } else {
        lasting
    };
    match there.len() {
        0 => "no serial adapter is plugged in".to_owned(),
        count => {
            let more = if count > NAMED_MAX { ", …" } else { "" };
            format!("there are {}{more}", there.into_iter().take(NAMED_MAX).collect::<Vec<_>>().join(", "))
        }
    }
}

fn names(folder: &Path, wanted: impl Fn(&str) -> bool) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .filter(|entry| entry.file_name().to_str().is_some_and(&wanted))
        .map(|entry| entry.path().display().to_string())
        .collect();
    names.sort();
    names
}

/// The process that has the port open, as far as this user may see it.
fn holder(port: &Path) -> Option<String> {
    let device = fs::metadata(port).ok()?.rdev();
    let own = std::process::id();
    fs::read_dir("/proc").ok()?.flatten().find_map(|process| {
        let number: u32 = process.file_name().to_str()?.parse().ok()?;
        let holds = fs::read_dir(process.path().join("fd")).ok()?.flatten().any(|file| {
            // A link to a terminal is identified by its target; other files are not examined.
            fs::read_link(file.path()).is_ok_and(|target| target.starts_with("/dev"))
                && fs::metadata(file.path()).is_ok_and(|file| file.rdev() == device)
        });
        let name = fs::read_to_string(process.path().join("comm")).unwrap_or_default();
        holds.then(|| match number == own {
            true => "this very process, for another device,".to_owned(),
            false => format!("process {number} ({})", name.trim()),
        })
    })
}

/// The group that may open the port, by name if available.
fn group(port: &Path) -> String {
    let Ok(gid) = fs::metadata(port).map(|port| port.gid()) else { return "dialout".to_owned() };
    let groups = fs::read_to_string("/etc/group").unwrap_or_default();
    let name = groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(gid)).then(|| name.to_owned())
    });
    name.unwrap_or_else(|| format!("number {gid}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_that_are_there_are_named_by_what_stays() {
        let folder = tempfile::tempdir().unwrap();
        let (by_id, devices) = (folder.path().join("by-id"), folder.path().join("dev"));
        fs::create_dir(&devices).unwrap();
        assert_eq!(ports_there(&by_id, &devices), "no serial adapter is plugged in");
        for name in ["ttyUSB1", "ttyUSB0", "tty1", "sda"] {
            fs::write(devices.join(name), "").unwrap();
        }
        let said = ports_there(&by_id, &devices);
        let port = |name: &str| devices.join(name).display().to_string();
        assert_eq!(said, format!("there are {}, {}", port("ttyUSB0"), port("ttyUSB1")));
        fs::create_dir(&by_id).unwrap();
        fs::write(by_id.join("usb-Maker_Plate_1-if00"), "").unwrap();
        let said = ports_there(&by_id, &devices);
        assert!(said.ends_with("by-id/usb-Maker_Plate_1-if00") && !said.contains("ttyUSB"), "{said}");
    }
}
