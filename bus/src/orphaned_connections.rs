//! Removes connections in shared memory whose publisher or subscriber no longer exists.
//!
//! A process killed between creating a connection and registering itself in it (`create_or_open_shm` and `reserve_port`
//! in `zero_copy_connection/common.rs` of iceoryx2-cal 0.10.0) leaves memory that names no port as its user. iceoryx2
//! removes a connection with its last user, hence never this one. A port writes its tag into the directory of its node
//! before it creates connections, so a connection without the tags of both its ports has lost one of them for good.
//! A surviving port that still maps the memory is not disturbed: the name is gone, the memory stays until it is unmapped.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Removes the orphaned connections in `memory` whose names begin with `prefix`; `nodes` holds the directories of all
/// nodes of the bus.
///
/// # Errors
/// A directory cannot be read. Nothing is removed then: an unread tag is not a missing one.
pub(crate) fn remove(memory: &Path, nodes: &Path, prefix: &str) -> io::Result<()> {
    // In this order: the tag of a connection that is listed exists before the tags are read.
    let connections = connections(memory, prefix)?;
    if connections.is_empty() {
        return Ok(());
    }
    let tags = port_tags(nodes, prefix)?;
    for (path, ports) in connections {
        if !ports.iter().all(|port| tags.contains(port)) {
            // If the removal fails, the next call tries again.
            let _ = fs::remove_file(path);
        }
    }
    Ok(())
}

/// Each connection with the identifiers of its sender and its receiver, from its name
/// `<prefix><type>_<sender>_<receiver>.connection`.
fn connections(memory: &Path, prefix: &str) -> io::Result<Vec<(PathBuf, [String; 2])>> {
    let mut connections = Vec::new();
    for entry in fs::read_dir(memory)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let ports = name.strip_prefix(prefix).and_then(|name| name.strip_suffix(".connection"));
        let mut ports = ports.unwrap_or_default().rsplit('_').map(str::to_owned);
        if let (Some(receiver), Some(sender)) = (ports.next(), ports.next()) {
            connections.push((path, [sender, receiver]));
        }
    }
    Ok(connections)
}

/// Identifiers of all ports, from the names `<prefix><port>.port_tag` in the directories of the nodes.
fn port_tags(nodes: &Path, prefix: &str) -> io::Result<BTreeSet<String>> {
    let mut tags = BTreeSet::new();
    for node in fs::read_dir(nodes)? {
        let node = node?.path();
        if !node.is_dir() {
            continue;
        }
        let files = match fs::read_dir(&node) {
            // The node has left since it was listed, and its connections with it.
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            files => files?,
        };
        for file in files {
            let name = file?.file_name();
            let tag = name.to_str().and_then(|name| name.strip_prefix(prefix)?.strip_suffix(".port_tag"));
            tags.extend(tag.map(str::to_owned));
        }
    }
    Ok(tags)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_goes_when_one_of_its_ports_has_no_tag() {
        let root = std::env::temp_dir().join(format!("orphaned-connections-{}", std::process::id()));
        let (memory, nodes) = (root.join("shm"), root.join("nodes"));
        fs::create_dir_all(&memory).unwrap();
        let make = |path: PathBuf| fs::write(path, "x").unwrap();
        for (node, port) in [("1", "11"), ("2", "22")] {
            fs::create_dir_all(nodes.join(node)).unwrap();
            make(nodes.join(node).join(format!("eqp_x_{port}.port_tag")));
        }
        make(nodes.join("eqp_x_1.node_monitor"));
        let kept = ["eqp_x_type_11_22.connection", "other_type_11_33.connection", "eqp_x_33.data"];
        let orphaned = ["eqp_x_type_11_33.connection", "eqp_x_type_33_22.connection"];
        kept.iter().chain(&orphaned).for_each(|name| make(memory.join(name)));
        remove(&memory, &nodes, "eqp_x_").unwrap();
        for name in kept {
            assert!(memory.join(name).exists(), "{name}");
        }
        for name in orphaned {
            assert!(!memory.join(name).exists(), "{name}");
        }
        remove(&memory, &root.join("unreadable"), "eqp_x_").unwrap_err();
        assert!(memory.join(kept[0]).exists());
        fs::remove_dir_all(&root).unwrap();
    }
}
