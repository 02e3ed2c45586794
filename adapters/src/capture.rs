//! Captures by other programs: motion and forces as CSV, motion as `.mvnx`, forces as text, network traffic as `.pcap`
//! and `.pcapng`.
//!
//! A capture is read as far as it is sound. What had to be left out is counted by reason, with the place of the
//! first of each ([`Rejected`]).

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
pub use mvnx::{MvnxCapture, MvnxError};
pub use pcap::{PcapCapture, PcapError};
pub use pcap_writer::{PcapWriteError, PcapWriter};
pub use rejected::Rejected;
pub use udp::UdpDatagram;
