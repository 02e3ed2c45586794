//! Writes UDP datagrams as a `.pcap` for Wireshark and tcpdump: nanosecond stamps, raw IP.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::net::{IpAddr, SocketAddr};
use std::path::Path;

use equipoise_core::time::NS_PER_S;
use etherparse::PacketBuilder;
use thiserror::Error;

/// Magic number of a `.pcap` with nanosecond stamps.
const MAGIC_NANOSECONDS: u32 = 0xa1b2_3c4d;
const VERSION_MAJOR: u16 = 2;
const VERSION_MINOR: u16 = 4;
const SNAP_LENGTH: u32 = 262_144;
const LINK_TYPE_RAW: u32 = 101;
const TIME_TO_LIVE: u8 = 64;

/// Why a datagram could not be written.
#[derive(Debug, Error)]
pub enum PcapWriteError {
    /// The file could not be created or written.
    #[error("cannot write the capture: {0}; check the directory and the space on the disk")]
    Io(#[from] io::Error),
    /// Source and destination are of different IP versions.
    #[error("no datagram goes from {0} to {1}: one is IPv4, the other IPv6")]
    MixedFamilies(SocketAddr, SocketAddr),
    /// The payload does not fit one UDP datagram, or the stamp is out of the format's range.
    #[error("a datagram of {payload_bytes} bytes at {time_ns} ns does not fit into a capture")]
    DoesNotFit {
        /// Bytes of the payload.
        payload_bytes: usize,
        /// The stamp.
        time_ns: u64,
    },
}

/// Writes a capture, datagram by datagram.
#[derive(Debug)]
pub struct PcapWriter<W: Write> {
    writer: W,
}

impl PcapWriter<BufWriter<File>> {
    /// Creates a file and writes its header.
    ///
    /// # Errors
    /// [`PcapWriteError::Io`].
    pub fn create(path: impl AsRef<Path>) -> Result<Self, PcapWriteError> {
        PcapWriter::new(BufWriter::new(File::create(path)?))
    }
}

impl<W: Write> PcapWriter<W> {
    /// Writes the file's header.
    ///
    /// # Errors
    /// [`PcapWriteError::Io`].
    pub fn new(mut writer: W) -> Result<Self, PcapWriteError> {
        writer.write_all(&MAGIC_NANOSECONDS.to_le_bytes())?;
        writer.write_all(&VERSION_MAJOR.to_le_bytes())?;
        writer.write_all(&VERSION_MINOR.to_le_bytes())?;
        // Time zone and accuracy: always zero.
        writer.write_all(&[0; 8])?;
        writer.write_all(&SNAP_LENGTH.to_le_bytes())?;
        writer.write_all(&LINK_TYPE_RAW.to_le_bytes())?;
        Ok(PcapWriter { writer })
    }

    /// Writes one datagram with valid IP and UDP headers; `time_ns` counts from 1970 (up to the year 2106).
    ///
    /// # Errors
    /// [`PcapWriteError`] if the addresses are of different IP versions, the payload does not fit one datagram, or the
    /// disk is full.
    pub fn write_udp(
        &mut self,
        time_ns: u64,
        source: SocketAddr,
        destination: SocketAddr,
        payload: &[u8],
    ) -> Result<(), PcapWriteError> {
        let does_not_fit = || PcapWriteError::DoesNotFit { payload_bytes: payload.len(), time_ns };
        let seconds = u32::try_from(time_ns / NS_PER_S).map_err(|_| does_not_fit())?;
        let nanoseconds = (time_ns % NS_PER_S) as u32;
        let ip = match (source.ip(), destination.ip()) {
            (IpAddr::V4(from), IpAddr::V4(to)) => {
                PacketBuilder::ipv4(from.octets(), to.octets(), TIME_TO_LIVE)
            }
            (IpAddr::V6(from), IpAddr::V6(to)) => {
                PacketBuilder::ipv6(from.octets(), to.octets(), TIME_TO_LIVE)
            }
            _ => return Err(PcapWriteError::MixedFamilies(source, destination)),
        };
        let mut packet = Vec::new();
        ip.udp(source.port(), destination.port()).write(&mut packet, payload).map_err(|_| does_not_fit())?;
        let length = u32::try_from(packet.len()).map_err(|_| does_not_fit())?;
        for word in [seconds, nanoseconds, length, length] {
            self.writer.write_all(&word.to_le_bytes())?;
        }
        self.writer.write_all(&packet)?;
        Ok(())
    }

    /// Flushes the data to the system and returns the underlying writer.
    ///
    /// # Errors
    /// [`PcapWriteError::Io`].
    pub fn finish(mut self) -> Result<W, PcapWriteError> {
        self.writer.flush()?;
        Ok(self.writer)
    }
}
