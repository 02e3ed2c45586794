//! Captures of other programs: motion and forces as CSV, motion as `.mvnx`, forces as text, network traffic as `.pcap`
//! and `.pcapng`.
//!
//! The valid parts of a capture are read. Omitted parts are counted by reason, with the position of the first of each
//! ([`Rejected`]).

pub mod bioware;
pub mod csv;
mod csv_columns;
pub mod lines;
pub mod mvnx;
pub mod pcap;
mod pcap_packets;
pub mod pcap_writer;
pub mod rejected;
mod udp;
mod window;

pub use bioware::{BioWareCapture, BioWareError, BioWareSettings, Units};
pub use csv::{CsvCapture, CsvError};
pub use mvnx::{MvnxCapture, MvnxError, WallClockSteps};
pub use pcap::{PcapCapture, PcapError};
pub use pcap_writer::{PcapWriteError, PcapWriter};
pub use rejected::Rejected;
pub use udp::UdpDatagram;
