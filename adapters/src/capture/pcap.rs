//! Network captures of Wireshark and tcpdump, `.pcap` and `.pcapng`, as UDP datagrams.
//!
//! Link layers: Ethernet (with VLAN tags), BSD loopback, Linux cooked (SLL, SLL2), raw IP. Fragmented IP datagrams are
//! reassembled.

use std::fmt;
use std::fs::File;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};

use equipoise_files::open_regular;
use thiserror::Error;

use super::pcap_packets::{Fault, Format, Item};
use super::rejected::Rejected;
use super::udp::{UdpAssembler, UdpDatagram};
use super::window::{RECORD_BYTES_MAX, Window};

/// Why a capture could not be read, or not to its end.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PcapError {
    /// The file could not be read.
    #[error("cannot read the capture {}: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        reason: String,
    },
    /// It is neither format.
    #[error("not a capture: it begins with \"{found}\"; give a .pcap or .pcapng file")]
    NotACapture {
        /// Its first bytes.
        found: String,
    },
    /// It ends within a packet.
    #[error("the capture ends within the record at byte {at_byte}, after {packets} packets; these were read")]
    Truncated {
        /// Position of the last, incomplete record.
        at_byte: usize,
        /// Packets before it.
        packets: u64,
    },
    /// An invalid record.
    #[error("the capture is corrupt at byte {at_byte}, after {packets} packets ({reason}); these were read")]
    Corrupt {
        /// Position of the invalid record.
        at_byte: usize,
        /// Packets before it.
        packets: u64,
        /// The reason.
        reason: String,
    },
}

/// The UDP datagrams of a capture in file order. Only a window of the file is in memory.
///
/// Other packets are counted in [`PcapCapture::rejected`], by packet number. Reasons: `not_ip`, `not_udp`, `malformed`,
/// `malformed_fragment`, `fragments_missing` (one for each datagram, counted at the end), `cut_short` (by the capture's
/// snap length), `unknown_link_type`, `unknown_interface`, `impossible_time`, `without_time`.
pub struct PcapCapture {
    window: Window,
    packets: u64,
    format: Format,
    assembler: UdpAssembler,
    rejected: Rejected,
    fault: Option<PcapError>,
    ended: bool,
}

impl fmt::Debug for PcapCapture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PcapCapture")
            .field("at_byte", &self.window.at_byte())
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
        let failed = |error: io::Error| PcapError::Io { path: path.to_owned(), reason: error.to_string() };
        PcapCapture::of_file(open_regular(path).map_err(failed)?, path)
    }

    /// The same for an opened file; `path` is its name in errors.
    ///
    /// # Errors
    /// As [`PcapCapture::open`].
    pub fn of_file(file: File, path: &Path) -> Result<PcapCapture, PcapError> {
        PcapCapture::read(Box::new(file), |reason| PcapError::Io { path: path.to_owned(), reason })
    }

    /// The same for bytes in memory.
    ///
    /// # Errors
    /// [`PcapError::NotACapture`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<PcapCapture, PcapError> {
        PcapCapture::read(Box::new(Cursor::new(bytes)), |reason| PcapError::Io {
            path: PathBuf::new(),
            reason,
        })
    }

    fn read(
        source: Box<dyn Read + Send>,
        failed: impl FnOnce(String) -> PcapError,
    ) -> Result<PcapCapture, PcapError> {
        let mut window = Window::open(source).map_err(|error| failed(error.to_string()))?;
        let begin = window.rest();
        let Some((format, head_bytes)) = Format::of(begin) else {
            let found = begin[..begin.len().min(16)].escape_ascii().to_string();
            return Err(PcapError::NotACapture { found });
        };
        window.pass(head_bytes);
        Ok(PcapCapture {
            window,
            packets: 0,
            format,
            assembler: UdpAssembler::new(),
            rejected: Rejected::numbered_by("packet"),
            fault: None,
            ended: false,
        })
    }

    /// Packets omitted so far, by reason.
    pub fn rejected(&self) -> &Rejected {
        &self.rejected
    }

    /// The fault that ended the reading before the end of the file, after the iterator has ended.
    pub fn fault(&self) -> Option<&PcapError> {
        self.fault.as_ref()
    }

    /// Reads more of the file; returns whether there was more. A read error ends the capture.
    fn read_on(&mut self) -> bool {
        match self.window.read_on() {
            Ok(has_more) => has_more,
            Err(error) => {
                self.end_with(Fault::Corrupt(format!("it cannot be read on: {error}")));
                false
            }
        }
    }

    fn end_with(&mut self, fault: Fault) {
        if self.ended {
            return;
        }
        let (at_byte, packets) = (self.window.at_byte(), self.packets);
        let too_long = self.window.rest().len() >= RECORD_BYTES_MAX;
        self.end(Some(match fault {
            Fault::Truncated if too_long => {
                let reason = format!("a record of more than {RECORD_BYTES_MAX} bytes");
                PcapError::Corrupt { at_byte, packets, reason }
            }
            Fault::Truncated => PcapError::Truncated { at_byte, packets },
            Fault::Corrupt(reason) => PcapError::Corrupt { at_byte, packets, reason },
        }));
    }

    fn end(&mut self, fault: Option<PcapError>) {
        self.ended = true;
        self.fault = fault;
        for _ in 0..self.assembler.discard_incomplete() {
            self.rejected.count("fragments_missing", self.packets);
        }
    }
}

impl Iterator for PcapCapture {
    type Item = UdpDatagram;

    fn next(&mut self) -> Option<UdpDatagram> {
        while !self.ended {
            if self.window.runs_low() {
                self.read_on();
            }
            if self.window.rest().is_empty() {
                break;
            }
            let (item, used) = match self.format.read(self.window.rest()) {
                Ok(read) => read,
                Err(fault) => {
                    if fault != Fault::Truncated || !self.read_on() {
                        self.end_with(fault);
                    }
                    continue;
                }
            };
            let outcome = match item {
                Item::Nothing => {
                    self.window.pass(used);
                    continue;
                }
                Item::Unusable(reason) => Err(reason),
                Item::Packet(packet) if !packet.is_complete => Err("cut_short"),
                Item::Packet(packet) => {
                    self.assembler.ingest(packet.time_ns, packet.link_type, packet.interface, packet.bytes)
                }
            };
            self.window.pass(used);
            self.packets += 1;
            match outcome {
                Ok(Some(datagram)) => return Some(datagram),
                Ok(None) => {}
                Err(reason) => self.rejected.count(reason, self.packets),
            }
        }
        if !self.ended {
            self.end(None);
        }
        None
    }
}
