//! Properties of every reader for arbitrary bytes, each a function that panics on a violation.
//!
//! `readers.rs` next to this folder tests them for a second with damaged and with arbitrary bytes; the targets in
//! `fuzz/` run for minutes. Their findings are added to `found.rs`.
#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::allow_attributes,
    reason = "shared by a test and by another workspace, which do not use all of it"
)]

pub(crate) mod captures;
pub(crate) mod choices;
pub(crate) mod devices;
pub(crate) mod forms;
pub(crate) mod found;
pub(crate) mod ground;
pub(crate) mod mvn;
pub(crate) mod recording;
pub(crate) mod seeds;
pub(crate) mod stomps;
pub(crate) mod suit;

/// One property with its name, which is that of its fuzz target.
pub(crate) struct Law {
    /// Name of target and seeds.
    pub(crate) name: &'static str,
    /// Panics if the property is violated.
    pub(crate) check: fn(&[u8]),
    /// Valid initial inputs.
    pub(crate) seeds: fn() -> Vec<Vec<u8>>,
}

/// All of them.
pub(crate) const LAWS: &[Law] = &[
    Law { name: "mvn_datagram", check: mvn::datagram, seeds: seeds::mvn_datagrams },
    Law { name: "mvn_assembler", check: suit::assembler, seeds: seeds::mvn_sessions },
    Law { name: "rdt", check: ground::rdt, seeds: seeds::rdt },
    Law { name: "pcap", check: captures::pcap, seeds: seeds::pcap },
    Law { name: "mvnx", check: captures::mvnx, seeds: seeds::mvnx },
    Law { name: "bioware", check: captures::bioware, seeds: seeds::bioware },
    Law { name: "csv", check: captures::csv, seeds: seeds::csv },
    Law { name: "recording", check: recording::recording, seeds: seeds::recordings },
    Law { name: "stomp", check: stomps::stomp, seeds: seeds::stomps },
    Law { name: "amti", check: devices::amti, seeds: devices::seeds::amti },
    Law { name: "bota", check: devices::bota, seeds: devices::seeds::bota },
    Law { name: "labamp", check: devices::labamp, seeds: devices::seeds::labamp },
    Law { name: "lsl", check: devices::lsl, seeds: devices::seeds::lsl },
    Law { name: "moticon", check: devices::moticon, seeds: devices::seeds::moticon },
    Law { name: "qtm", check: devices::qtm, seeds: devices::seeds::qtm },
    Law { name: "tec_gihan", check: devices::tec_gihan, seeds: devices::seeds::tec_gihan },
    Law { name: "text", check: devices::text, seeds: devices::seeds::text },
    Law { name: "binary", check: forms::binary, seeds: forms::seeds::binary },
    Law { name: "mvn_stream", check: forms::mvn_stream, seeds: forms::seeds::mvn_stream },
    Law { name: "netft_xml", check: forms::netft_xml, seeds: forms::seeds::netft_xml },
];
