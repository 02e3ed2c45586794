//! Fault of an adapter in a separate process: a small file in the bus directory, which the daemon reads once a second
//! for its incidents. `Health` on the bus has counts but no text.

use std::io::ErrorKind;
use std::path::PathBuf;

use equipoise_files::read_text;

use equipoise_files::atomic_file::write_atomically;

/// Maximum size of the file, bytes.
const FAULT_BYTES_MAX: u64 = 16 << 10;

/// Publishes the fault that prevents a stream's adapter from working, or `None` if there is none. A failed write is
/// only logged.
pub fn publish(station: &str, stream: &str, fault: Option<&str>) {
    let path = path_of(station, stream);
    let written = match fault {
        Some(fault) => serde_json::to_string(fault)
            .map_err(std::io::Error::from)
            .and_then(|text| write_atomically(&path, text.as_bytes())),
        None => match std::fs::remove_file(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
            removed => removed,
        },
    };
    if let Err(error) = written {
        tracing::warn!("{}: {error}; the daemon does not report this adapter's fault", path.display());
    }
}

/// The last published fault of a stream's adapter; `None` if it works or never ran.
pub fn read(station: &str, stream: &str) -> Option<String> {
    serde_json::from_str(&read_text(&path_of(station, stream), FAULT_BYTES_MAX).ok()?).ok()
}

fn path_of(station: &str, stream: &str) -> PathBuf {
    equipoise_bus::root::root_of_environment().join(format!("equipoise-{station}.{stream}.json"))
}
