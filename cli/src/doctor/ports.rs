//! Finds the process that uses a port.

use std::collections::BTreeSet;
use std::io;
use std::net::{SocketAddr, TcpListener, UdpSocket};

use equipoise_adapters::source::MvnTransport;
use equipoise_config::SuitConfig;
use serde::Serialize;

/// State of a port.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Port {
    /// No process uses it.
    #[default]
    Free,
    /// A process of this station uses it.
    OwnProcess,
    /// Another process uses it.
    InUse,
    /// Its address is not one of this computer.
    AddressUnavailable,
}

pub(super) fn port_of(bound: io::Result<()>) -> Port {
    match bound {
        Ok(()) => Port::Free,
        Err(error) if error.kind() == io::ErrorKind::AddrNotAvailable => Port::AddressUnavailable,
        Err(_) => Port::InUse,
    }
}

/// The kernel's tables of sockets.
pub(super) const UDP: [&str; 2] = ["/proc/self/net/udp", "/proc/self/net/udp6"];
pub(super) const TCP: [&str; 2] = ["/proc/self/net/tcp", "/proc/self/net/tcp6"];

/// The inodes of the sockets at an address's port.
pub(super) fn sockets_at(tables: [&str; 2], address: SocketAddr) -> Vec<String> {
    let texts = tables.map(|table| std::fs::read_to_string(table).unwrap_or_default());
    texts.iter().flat_map(|text| inodes_at(text, address.port())).collect()
}

fn inodes_at(table: &str, port: u16) -> Vec<String> {
    let at_port = |line: &str| {
        let mut fields = line.split_whitespace();
        let (_, local_port) = fields.nth(1)?.rsplit_once(':')?;
        // The inode is the tenth field; it is 0 for closed connections.
        let inode = fields.nth(7).filter(|inode| *inode != "0")?;
        (u16::from_str_radix(local_port, 16) == Ok(port)).then(|| inode.to_owned())
    };
    table.lines().skip(1).filter_map(at_port).collect()
}

/// Tries to bind the suit's address; also returns the kernel's tables that would list its sockets.
pub(super) fn bind_suit(suit: &SuitConfig) -> (io::Result<()>, [&'static str; 2]) {
    match suit.source.transport() {
        Some(MvnTransport::Tcp) => (TcpListener::bind(suit.listen).map(drop), TCP),
        Some(MvnTransport::Udp) | None => (UdpSocket::bind(suit.listen).map(drop), UDP),
    }
}

/// Whether one of the processes has one of the sockets; assumed for a process that may not be inspected.
pub(super) fn holds(processes: &BTreeSet<u32>, inodes: &[String]) -> bool {
    let own = std::process::id();
    processes
        .iter()
        .filter(|process| **process != own)
        .any(|process| holds_socket(*process, inodes).unwrap_or(true))
}

/// A process that uses a port.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Holder {
    /// Process id.
    pub process_id: u32,
    /// The program's name in the kernel.
    pub program: String,
}

/// The first process that has one of the sockets, among those that may be inspected.
pub(super) fn holder_of(inodes: &[String]) -> Option<Holder> {
    let processes = std::fs::read_dir("/proc").ok()?.flatten();
    let mut ids = processes.filter_map(|entry| entry.file_name().to_string_lossy().parse::<u32>().ok());
    let process_id = ids.find(|id| holds_socket(*id, inodes) == Some(true))?;
    let program = std::fs::read_to_string(format!("/proc/{process_id}/comm")).unwrap_or_default();
    Some(Holder { process_id, program: program.trim().to_owned() })
}

/// Whether a process has one of the sockets; `None` if it may not be inspected.
fn holds_socket(process: u32, inodes: &[String]) -> Option<bool> {
    let descriptors = std::fs::read_dir(format!("/proc/{process}/fd")).ok()?;
    let mut links = descriptors.flatten().filter_map(|entry| std::fs::read_link(entry.path()).ok());
    Some(links.any(|link| {
        let link = link.to_string_lossy();
        let inode = link.strip_prefix("socket:[").and_then(|rest| rest.strip_suffix(']'));
        inode.is_some_and(|inode| inodes.iter().any(|held| held == inode))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_is_found_by_its_port_and_its_holder_by_the_inode() {
        let table = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode \
                     ref pointer drops\n 1: 0100007F:2623 00000000:0000 07 00000000:00000000 00:00000000 00000000  \
                     104        0 4711 2 0 0\n 2: 0100007F:2624 00000000:0000 07 00000000:00000000 00:00000000 \
                     00000000   104        0 4712 2 0 0\n";
        assert_eq!(inodes_at(table, 9763), ["4711"]);
        assert!(inodes_at(table, 1).is_empty());
        assert!(!holds(&BTreeSet::new(), &["4711".to_owned()]));
    }

    #[test]
    fn the_process_of_a_port_is_named() {
        let occupied = UdpSocket::bind("127.0.0.1:0").unwrap();
        let inodes = sockets_at(UDP, occupied.local_addr().unwrap());
        let holder = holder_of(&inodes).expect("this very process");
        assert_eq!(holder.process_id, std::process::id());
        assert!(!holder.program.is_empty());
        assert_eq!(holder_of(&[]), None);
    }
}
