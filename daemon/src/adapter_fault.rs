//! The fault of an adapter that is a process of its own: a small file among those of the bus, which the daemon reads once a
//! second for its incidents. `Health` on the bus has counts and no text.

use std::io::ErrorKind;
use std::path::PathBuf;

use equipoise_files::read_text;

use crate::whole_file::write_whole;

/// The longest fault that is read, bytes.
const FAULT_BYTES_MAX: u64 = 16 << 10;

/// Publishes what prevents a stream's adapter from working, or with `None` that nothing does. A file that cannot be written
/// is logged and stops nothing.
pub fn publish(station: &str, stream: &str, fault: Option<&str>) {
    let path = path_of(station, stream);
    let written = match fault {
        Some(fault) => serde_json::to_string(fault)
            .map_err(std::io::Error::from)
            .and_then(|text| write_whole(&path, text.as_bytes())),
        None => match std::fs::remove_file(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
            removed => removed,
        },
    };
    if let Err(error) = written {
        tracing::warn!("{}: {error}; the daemon does not report this adapter's fault", path.display());
    }
}

/// The fault that a stream's adapter published last; `None` if it works, or never ran.
pub fn read(station: &str, stream: &str) -> Option<String> {
    serde_json::from_str(&read_text(&path_of(station, stream), FAULT_BYTES_MAX).ok()?).ok()
}

fn path_of(station: &str, stream: &str) -> PathBuf {
    equipoise_bus::root::root_of_environment().join(format!("equipoise-{station}.{stream}.json"))
}
