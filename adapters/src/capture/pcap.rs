//! Network captures of Wireshark and tcpdump, `.pcap` and `.pcapng`, as UDP datagrams.
//!
//! Link layers: Ethernet (with VLAN tags), BSD loopback, Linux cooked (SLL, SLL2), raw IP. Fragmented IP datagrams
//! are put together again.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::pcap_packets::{Fault, Format, Item};
use super::rejected::Rejected;
use super::udp::{UdpAssembler, UdpDatagram};

/// The longest capture, bytes: it is held in memory whole. Two hours of suit and plate at 1 kHz have 2 GB.
const CAPTURE_BYTES_MAX: u64 = 4 << 30;

/// Why a capture could not be read at all, or not to its end.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PcapError {
    /// The file could not be read.
    #[error("cannot read the capture {}: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        reason: String,
    },
    /// It is neither format.
    #[error("not a capture: it begins with \"{found}\"; give a .pcap or .pcapng file")]
    NotACapture {
        /// What it begins with.
        found: String,
    },
    /// It ends within a packet.
    #[error("the capture ends within the record at byte {at_byte}, after {packets} packets; these were read")]
    Truncated {
        /// Where the last, incomplete record begins.
        at_byte: usize,
        /// Packets before it.
        packets: u64,
    },
    /// It goes on with something that is no record.
    #[error("the capture is corrupt at byte {at_byte}, after {packets} packets ({reason}); these were read")]
    Corrupt {
        /// Where the broken record begins.
        at_byte: usize,
        /// Packets before it.
        packets: u64,
        /// What is wrong.
        reason: String,
    },
}

/// The UDP datagrams of a capture in file order.
///
/// Other packets are counted in [`PcapCapture::rejected`], by packet number. Reasons: `not_ip`, `not_udp`,
/// `malformed`, `malformed_fragment`, `fragments_missing` (one per datagram, counted at the end), `cut_short` (by
/// the capture's snap length), `unknown_link_type`, `unknown_interface`, `impossible_time`, `without_time`.
pub struct PcapCapture {
    bytes: Vec<u8>,
    at: usize,
    packets: u64,
    format: Format,
    assembler: UdpAssembler,
    rejected: Rejected,
    fault: Option<PcapError>,
}

impl fmt::Debug for PcapCapture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PcapCapture")
            .field("bytes", &self.bytes.len())
            .field("at", &self.at)
            .field("packets", &self.packets)
            .field("fault", &self.fault)
            .finish_non_exhaustive()
    }
}

impl PcapCapture {
    /// Opens a capture.
    ///
    /// # Errors
    /// [`PcapError::Io`] or [`PcapError::NotACapture`].
    pub fn open(path: impl AsRef<Path>) -> Result<PcapCapture, PcapError> {
        let path = path.as_ref();
        let failed = |reason: String| PcapError::Io { path: path.to_owned(), reason };
        let file = File::open(path).map_err(|error| failed(error.to_string()))?;
        let mut bytes = Vec::new();
        file.take(CAPTURE_BYTES_MAX + 1)
            .read_to_end(&mut bytes)
            .map_err(|error| failed(error.to_string()))?;
        if bytes.len() as u64 > CAPTURE_BYTES_MAX {
            let reason =
                format!("it is longer than {CAPTURE_BYTES_MAX} bytes; cut it into parts (editcap -c)");
            return Err(failed(reason));
        }
        PcapCapture::from_bytes(bytes)
    }

    /// The same from bytes.
    ///
    /// # Errors
    /// [`PcapError::NotACapture`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<PcapCapture, PcapError> {
        let Some((format, at)) = Format::of(&bytes) else {
            let found = bytes[..bytes.len().min(16)].escape_ascii().to_string();
            return Err(PcapError::NotACapture { found });
        };
        Ok(PcapCapture {
            bytes,
            at,
            packets: 0,
            format,
            assembler: UdpAssembler::new(),
            rejected: Rejected::by("packet"),
            fault: None,
        })
    }

    /// Packets left out so far, by reason.
    pub fn rejected(&self) -> &Rejected {
        &self.rejected
    }

    /// What ended the reading before the end of the file, once the iterator has ended.
    pub fn fault(&self) -> Option<&PcapError> {
        self.fault.as_ref()
    }

    fn end(&mut self, fault: Option<PcapError>) {
        self.at = self.bytes.len();
        self.fault = fault;
        for _ in 0..self.assembler.forget_incomplete() {
            self.rejected.count("fragments_missing", self.packets);
        }
    }
}

impl Iterator for PcapCapture {
    type Item = UdpDatagram;

    fn next(&mut self) -> Option<UdpDatagram> {
        while self.at < self.bytes.len() {
            let (item, used) = match self.format.read(&self.bytes[self.at..]) {
                Ok(read) => read,
                Err(fault) => {
                    let (at_byte, packets) = (self.at, self.packets);
                    self.end(Some(match fault {
                        Fault::Truncated => PcapError::Truncated { at_byte, packets },
                        Fault::Corrupt(reason) => PcapError::Corrupt { at_byte, packets, reason },
                    }));
                    return None;
                }
            };
            let outcome = match item {
                Item::Nothing => {
                    self.at += used;
                    continue;
                }
                Item::Unusable(reason) => Err(reason),
                Item::Packet(packet) if !packet.whole => Err("cut_short"),
                Item::Packet(packet) => {
                    self.assembler.take(packet.time_ns, packet.link_type, packet.interface, packet.bytes)
                }
            };
            self.at += used;
            self.packets += 1;
            match outcome {
                Ok(Some(datagram)) => return Some(datagram),
                Ok(None) => {}
                Err(reason) => self.rejected.count(reason, self.packets),
            }
        }
        if self.fault.is_none() {
            self.end(None);
        }
        None
    }
}
