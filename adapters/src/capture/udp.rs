//! Extracts a UDP datagram from a captured packet of any link layer.

use std::cell::Cell;
use std::net::{IpAddr, SocketAddr};

use etherparse::defrag::IpDefragPool;
use etherparse::{EtherType, IpNumber, NetSlice, SlicedPacket, TransportSlice, UdpSlice};

/// Linux discards fragments after this time (net.ipv4.ipfrag_time), so later ones belong to another datagram.
const FRAGMENT_LIFE_NS: u64 = 30_000_000_000;
/// Maximum count of incomplete datagrams, of at most 64 KiB each: Linux's limit (net.ipv4.ipfrag_high_thresh, 4 MiB).
const INCOMPLETE_MAX: u64 = 64;

/// One UDP datagram of a capture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdpDatagram {
    /// Capture time: wall-clock time, ns since 1970 (the capture's own clock). For fragments, that of the last one.
    pub time_ns: u64,
    /// The sender.
    pub source: SocketAddr,
    /// The destination.
    pub destination: SocketAddr,
    /// The payload.
    pub payload: Vec<u8>,
}

/// Link-layer header types (tcpdump.org/linktypes.html).
mod link_type {
    pub(super) const NULL: i32 = 0;
    pub(super) const ETHERNET: i32 = 1;
    /// DLT_RAW by the numbers that OpenBSD and others use in files.
    pub(super) const RAW_BSD: i32 = 12;
    pub(super) const RAW_OPENBSD: i32 = 14;
    pub(super) const RAW: i32 = 101;
    pub(super) const LOOP: i32 = 108;
    pub(super) const LINUX_SLL: i32 = 113;
    pub(super) const IPV4: i32 = 228;
    pub(super) const IPV6: i32 = 229;
    pub(super) const LINUX_SLL2: i32 = 276;
}

/// Reassembles datagrams; stores the fragments of incomplete ones.
pub(super) struct UdpAssembler {
    fragments: IpDefragPool<u64, u32>,
    /// Count of discarded datagrams.
    discarded: u64,
}

impl UdpAssembler {
    pub(super) fn new() -> UdpAssembler {
        UdpAssembler { fragments: IpDefragPool::new(), discarded: 0 }
    }

    /// The datagram that a packet completes; `None` for a fragment with others missing.
    ///
    /// # Errors
    /// The reason why the packet is skipped.
    pub(super) fn ingest(
        &mut self,
        time_ns: u64,
        link_type: i32,
        interface: u32,
        bytes: &[u8],
    ) -> Result<Option<UdpDatagram>, &'static str> {
        let packet = slice(link_type, bytes)?;
        let (source, destination) = match &packet.net {
            Some(NetSlice::Ipv4(ip)) => {
                (IpAddr::V4(ip.header().source_addr()), IpAddr::V4(ip.header().destination_addr()))
            }
            Some(NetSlice::Ipv6(ip)) => {
                (IpAddr::V6(ip.header().source_addr()), IpAddr::V6(ip.header().destination_addr()))
            }
            _ => return Err("not_ip"),
        };
        let datagram = |udp: &UdpSlice<'_>| UdpDatagram {
            time_ns,
            source: SocketAddr::new(source, udp.source_port()),
            destination: SocketAddr::new(destination, udp.destination_port()),
            payload: udp.payload().to_vec(),
        };
        if let Some(TransportSlice::Udp(udp)) = &packet.transport {
            return Ok(Some(datagram(udp)));
        }
        let ip = packet.ip_payload().ok_or("not_ip")?;
        if ip.ip_number != IpNumber::UDP {
            return Err("not_udp");
        }
        // A UDP packet that was not sliced as UDP is a fragment.
        self.discard_old(time_ns);
        match self.fragments.process_sliced_packet(&packet, time_ns, interface) {
            Ok(None) => Ok(None),
            Ok(Some(whole)) => {
                let udp = UdpSlice::from_slice(&whole.payload).map_err(|_| "malformed")?;
                let datagram = datagram(&udp);
                self.fragments.return_buf(whole);
                Ok(Some(datagram))
            }
            Err(_) => Err("malformed_fragment"),
        }
    }

    /// Discards expired incomplete datagrams, and the oldest if there are too many.
    fn discard_old(&mut self, time_ns: u64) {
        let since_ns = time_ns.saturating_sub(FRAGMENT_LIFE_NS);
        let (waiting, oldest_ns) = self.retain(|newest_ns| newest_ns >= since_ns);
        if waiting >= INCOMPLETE_MAX {
            self.retain(|newest_ns| newest_ns > oldest_ns);
        }
    }

    /// Keeps the datagrams for which `is_kept` is true of the time of their newest fragment; returns their count, and the
    /// time of the oldest.
    fn retain(&mut self, is_kept: impl Fn(u64) -> bool) -> (u64, u64) {
        let (waiting, discarded, oldest_ns) = (Cell::new(0), Cell::new(0), Cell::new(u64::MAX));
        // The pool provides neither its size nor its times, but calls the predicate once for each datagram.
        self.fragments.retain(|newest_ns| {
            let count = if is_kept(*newest_ns) { &waiting } else { &discarded };
            count.set(count.get() + 1);
            if is_kept(*newest_ns) {
                oldest_ns.set(oldest_ns.get().min(*newest_ns));
            }
            true
        });
        if discarded.get() > 0 {
            self.fragments.retain(|newest_ns| is_kept(*newest_ns));
        }
        self.discarded += discarded.get();
        (waiting.get(), oldest_ns.get())
    }

    /// Returns the count of incomplete datagrams, and discards them.
    pub(super) fn discard_incomplete(&mut self) -> u64 {
        self.retain(|_| false);
        std::mem::take(&mut self.discarded)
    }
}

/// Removes the link layer.
fn slice(link_type: i32, bytes: &[u8]) -> Result<SlicedPacket<'_>, &'static str> {
    use link_type::{ETHERNET, IPV4, IPV6, LINUX_SLL, LINUX_SLL2, LOOP, NULL, RAW, RAW_BSD, RAW_OPENBSD};
    let after = |length: usize| bytes.get(length..).ok_or("malformed");
    // Linux "cooked" headers contain the EtherType at a fixed position.
    let cooked = |ether_type_at: usize, length: usize| match bytes.get(ether_type_at..ether_type_at + 2) {
        Some(&[high, low]) => Ok((EtherType(u16::from_be_bytes([high, low])), after(length)?)),
        _ => Err("malformed"),
    };
    let packet = match link_type {
        ETHERNET => SlicedPacket::from_ethernet(bytes),
        // Four bytes of address family, in the byte order of the capturing computer; the IP version contains the same
        // information.
        NULL | LOOP => SlicedPacket::from_ip(after(4)?),
        RAW | RAW_BSD | RAW_OPENBSD | IPV4 | IPV6 => SlicedPacket::from_ip(bytes),
        LINUX_SLL => {
            let (ether_type, rest) = cooked(14, 16)?;
            SlicedPacket::from_ether_type(ether_type, rest)
        }
        LINUX_SLL2 => {
            let (ether_type, rest) = cooked(0, 20)?;
            SlicedPacket::from_ether_type(ether_type, rest)
        }
        _ => return Err("unknown_link_type"),
    };
    packet.map_err(|_| "malformed")
}
