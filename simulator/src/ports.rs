//! Port numbers for hosts that require a fixed one.
//!
//! A port that the kernel chose and that was released may be chosen again at once for any other socket of the machine.
//! These ports lie below the kernel's range (from 32768 unless configured), and each is assigned only once per process.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, UdpSocket};
use std::process;
use std::sync::atomic::{AtomicU32, Ordering};

const FIRST: u32 = 20_000;
const PORTS: u32 = 12_000;
/// Offset between processes with consecutive numbers; coprime to [`PORTS`], so that every port is reached.
const STRIDE: u32 = 101;

/// An address of loopback whose port is free for both UDP and TCP, on all addresses.
///
/// # Errors
/// Every port of the range is in use.
pub fn free_address() -> io::Result<SocketAddr> {
    static HANDED_OUT: AtomicU32 = AtomicU32::new(0);
    let start = process::id().wrapping_mul(STRIDE);
    for _ in 0..PORTS {
        let turn = HANDED_OUT.fetch_add(1, Ordering::Relaxed);
        let port = (FIRST + start.wrapping_add(turn) % PORTS) as u16;
        let everywhere = (Ipv4Addr::UNSPECIFIED, port);
        if UdpSocket::bind(everywhere).is_ok() && TcpListener::bind(everywhere).is_ok() {
            return Ok((Ipv4Addr::LOCALHOST, port).into());
        }
    }
    Err(io::Error::new(
        io::ErrorKind::AddrInUse,
        format!("all ports from {FIRST} to {} are taken", FIRST + PORTS - 1),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_free_and_handed_out_once() {
        let addresses: Vec<SocketAddr> = (0..50).map(|_| free_address().unwrap()).collect();
        let sockets: Vec<UdpSocket> =
            addresses.iter().map(|address| UdpSocket::bind(address).unwrap()).collect();
        assert_eq!(sockets.len(), addresses.len());
        assert!(addresses.iter().all(|address| address.port() < 32_768), "{addresses:?}");
    }
}
