//! Root directory of the bus and prefix of its shared memory.
//!
//! Buses with different roots are isolated from each other. On iceoryx2's default root, tools and bindings of other
//! languages find the bus without configuration.

use crate::error::BusError;
use iceoryx2::prelude::{Config, FileName, Path, SemanticString};
use std::env;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;

/// Environment variable with the root directory; takes precedence over all other sources.
pub const ROOT_VARIABLE: &str = "EQUIPOISE_BUS_ROOT";
/// iceoryx2's default root.
pub const DEFAULT_ROOT: &str = "/tmp/iceoryx2";

/// Maximum length of the root, bytes.
///
/// The path of a listener's socket lies under the root. Root and socket name, which contains an id that grows to 39
/// digits over the years, must fit into the 108 bytes of a Unix socket address (unix(7)).
pub const ROOT_BYTES_MAX: usize = 46;

/// The root of the environment: `$EQUIPOISE_BUS_ROOT`, else `iceoryx2` in systemd's `$RUNTIME_DIRECTORY`, else
/// [`DEFAULT_ROOT`].
pub fn root_of_environment() -> PathBuf {
    choose_root(env::var(ROOT_VARIABLE).ok(), env::var("RUNTIME_DIRECTORY").ok())
}

fn choose_root(explicit: Option<String>, runtime_directory: Option<String>) -> PathBuf {
    let set = |value: Option<String>| value.filter(|text| !text.is_empty());
    if let Some(root) = set(explicit) {
        return PathBuf::from(root);
    }
    // systemd separates several runtime directories by colons; the first is the service's own.
    match set(runtime_directory).as_deref().and_then(|list| list.split(':').next()) {
        Some(first) => PathBuf::from(first).join("iceoryx2"),
        None => PathBuf::from(DEFAULT_ROOT),
    }
}

/// The complete configuration in code: otherwise iceoryx2 silently reads a `./config/iceoryx2.toml`.
pub(crate) fn config(root: &std::path::Path) -> Result<Config, BusError> {
    let refused = || BusError::Root { root: root.to_owned() };
    let text = root.to_str().filter(|_| root.is_absolute()).ok_or_else(refused)?.trim_end_matches('/');
    if text.len() > ROOT_BYTES_MAX {
        return Err(refused());
    }
    let mut config = Config::default();
    let path = Path::new(format!("{text}/").as_bytes()).map_err(|_| refused())?;
    config.global.set_root_path(&path);
    // A process killed during a clean-up leaves remains that cannot be cleaned up any more, and consumers may be killed
    // at any time. So only the daemon cleans up, and a process that finds no free port (`open::take`).
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    config.global.prefix = FileName::new(shared_memory_prefix(root).as_bytes()).map_err(|_| refused())?;
    Ok(config)
}

/// Prefix of the bus's names in shared memory. Other languages and tools need it in addition to the root.
///
/// Names in `/dev/shm` have no directories, so each root has its own prefix.
pub fn shared_memory_prefix(root: &std::path::Path) -> String {
    let text = root.to_string_lossy();
    let text = text.trim_end_matches('/');
    if text == DEFAULT_ROOT {
        return "iox2_".to_owned();
    }
    let fnv1a = |hash: u32, byte: u8| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193);
    format!("eqp_{:08x}_", text.bytes().fold(0x811c_9dc5, fnv1a))
}

/// Restricts iceoryx2's node counter to its owner, as all other files of a root of our own are. iceoryx2 creates it
/// writable for all users; truncating that file would crash the next process that joins.
pub(crate) fn close_counters_to_others(root: &std::path::Path) {
    let prefix = shared_memory_prefix(root);
    if prefix == shared_memory_prefix(std::path::Path::new(DEFAULT_ROOT)) {
        // The default root is shared with other programs that use iceoryx2.
        return;
    }
    for file in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
        let name = file.file_name();
        let name = name.to_string_lossy();
        if name.starts_with(&prefix) && name.ends_with(".global_mgmt") {
            // The change fails for a file of another user, which is not ours to protect.
            let _ = fs::set_permissions(file.path(), fs::Permissions::from_mode(0o600));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_explicit_root_wins_then_systemd_then_the_default() {
        let some = |text: &str| Some(text.to_owned());
        assert_eq!(choose_root(some("/a"), some("/run/equipoise")), PathBuf::from("/a"));
        assert_eq!(choose_root(some(""), some("/run/e:/run/f")), PathBuf::from("/run/e/iceoryx2"));
        assert_eq!(choose_root(None, None), PathBuf::from(DEFAULT_ROOT));
    }

    #[test]
    fn other_roots_have_other_prefixes_and_a_slash_does_not_matter() {
        let of = |root: &str| config(std::path::Path::new(root)).unwrap().global.prefix;
        assert_eq!(of("/run/a"), of("/run/a/"));
        assert_ne!(of("/run/a"), of("/run/b"));
        assert_eq!(of("/tmp/iceoryx2/"), Config::default().global.prefix);
    }

    #[test]
    fn a_relative_root_is_refused() {
        assert!(matches!(config(std::path::Path::new("here")), Err(BusError::Root { .. })));
    }
}
