//! The packets in a `.pcap` or `.pcapng` file, one after the other, up to the first fault.

use pcap_parser::nom::Err as NomErr;
use pcap_parser::{
    Block, InterfaceDescriptionBlock, LegacyPcapBlock, PcapError as ParseError, PcapHeader, parse_block_be,
    parse_block_le, parse_pcap_frame, parse_pcap_frame_be, parse_pcap_frame_modified, parse_pcap_header,
};

const NS_PER_S: u64 = equipoise_core::time::NS_PER_S;
const PCAPNG_MAGIC: [u8; 4] = [0x0a, 0x0d, 0x0d, 0x0a];

/// One captured packet.
pub(super) struct Packet<'a> {
    pub(super) time_ns: u64,
    pub(super) link_type: i32,
    pub(super) interface: u32,
    /// Whether the capture contains all of its bytes.
    pub(super) is_complete: bool,
    pub(super) bytes: &'a [u8],
}

/// Element at a position of the file.
pub(super) enum Item<'a> {
    Packet(Packet<'a>),
    /// An unusable packet, and why.
    Unusable(&'static str),
    /// An element without a packet.
    Nothing,
}

/// Fault that ends the reading of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Fault {
    Truncated,
    Corrupt(String),
}

/// Properties from the file's header that are needed to read on.
#[derive(Debug)]
pub(super) enum Format {
    Pcap(PcapHeader),
    PcapNg { big_endian: bool, interfaces: Vec<Interface> },
}

#[derive(Debug)]
pub(super) struct Interface {
    link_type: i32,
    /// Units of its time stamps per second; `None` if the file contains an impossible value.
    units_per_s: Option<u128>,
    offset_s: i64,
}

impl Format {
    /// Parses the header; returns it and its length. `None` if it is neither format.
    pub(super) fn of(bytes: &[u8]) -> Option<(Format, usize)> {
        if bytes.starts_with(&PCAPNG_MAGIC) {
            return Some((Format::PcapNg { big_endian: false, interfaces: Vec::new() }, 0));
        }
        let (rest, header) = parse_pcap_header(bytes).ok()?;
        Some((Format::Pcap(header), bytes.len() - rest.len()))
    }

    /// Parses the element at the front of `bytes`; returns it and its length.
    pub(super) fn read<'a>(&mut self, bytes: &'a [u8]) -> Result<(Item<'a>, usize), Fault> {
        match self {
            Format::Pcap(header) => {
                let parsed = match (header.is_bigendian(), header.is_modified_format()) {
                    (_, true) => parse_pcap_frame_modified(bytes),
                    (true, _) => parse_pcap_frame_be(bytes),
                    (false, _) => parse_pcap_frame(bytes),
                };
                let (rest, block) = parsed.map_err(fault)?;
                Ok((Item::Packet(pcap_packet(header, &block)), bytes.len() - rest.len()))
            }
            Format::PcapNg { big_endian, interfaces } => {
                if let Some(used) = skipped_block_length(*big_endian, bytes)? {
                    return Ok((Item::Nothing, used));
                }
                // A section header parses the same in both byte orders, and defines the order of the following blocks.
                let parsed = if *big_endian { parse_block_be(bytes) } else { parse_block_le(bytes) };
                let (rest, block) = parsed.map_err(fault)?;
                let used = bytes.len() - rest.len();
                if used == 0 {
                    return Err(Fault::Corrupt("a block of no length".to_owned()));
                }
                Ok((pcapng_item(big_endian, interfaces, block), used))
            }
        }
    }
}

/// The length of a block without packets. It is skipped here, as its contents (names, secrets, statistics, logs) are
/// irrelevant and the parser trusts their lengths. `None` for other blocks.
fn skipped_block_length(big_endian: bool, bytes: &[u8]) -> Result<Option<usize>, Fault> {
    const SECTION: u32 = 0x0a0d_0d0a;
    const INTERFACE: u32 = 1;
    const SIMPLE_PACKET: u32 = 3;
    const ENHANCED_PACKET: u32 = 6;
    /// Type, length, and length repeated.
    const BLOCK_BYTES_MIN: usize = 12;
    let word = |at: usize| {
        let word =
            bytes.get(at..at + 4).and_then(|word| <[u8; 4]>::try_from(word).ok()).ok_or(Fault::Truncated)?;
        Ok(if big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) })
    };
    let (kind, length) = (word(0)?, word(4)? as usize);
    match kind {
        SECTION | INTERFACE | SIMPLE_PACKET => return Ok(None),
        // A packet that is longer than its block would cause an overflow in its alignment.
        ENHANCED_PACKET if length < BLOCK_BYTES_MIN || word(20)? as usize <= length => return Ok(None),
        ENHANCED_PACKET => return Err(Fault::Corrupt("a packet that is longer than its block".to_owned())),
        _ if length < BLOCK_BYTES_MIN => {}
        _ if length > bytes.len() => return Err(Fault::Truncated),
        _ => return Ok(Some(length)),
    }
    Err(Fault::Corrupt(format!("a block of {length} bytes")))
}

fn pcap_packet<'a>(header: &PcapHeader, block: &LegacyPcapBlock<'a>) -> Packet<'a> {
    let ns_per_unit = if header.is_nanosecond_precision() { 1 } else { 1_000 };
    Packet {
        time_ns: u64::from(block.ts_sec) * NS_PER_S + u64::from(block.ts_usec) * ns_per_unit,
        // The upper bits contain the length of a frame check sequence.
        link_type: header.network.0 & 0xffff,
        interface: 0,
        is_complete: block.caplen >= block.origlen,
        bytes: block.data,
    }
}

fn pcapng_item<'a>(big_endian: &mut bool, interfaces: &mut Vec<Interface>, block: Block<'a>) -> Item<'a> {
    match block {
        Block::SectionHeader(section) => {
            *big_endian = section.big_endian();
            interfaces.clear();
            Item::Nothing
        }
        Block::InterfaceDescription(description) => {
            interfaces.push(interface(&description));
            Item::Nothing
        }
        Block::EnhancedPacket(packet) => {
            let Some(interface) = interfaces.get(packet.if_id as usize) else {
                return Item::Unusable("unknown_interface");
            };
            let units = u128::from(packet.ts_high) << 32 | u128::from(packet.ts_low);
            let Some(time_ns) = interface.time_ns(units) else { return Item::Unusable("impossible_time") };
            let Some(bytes) = packet.data.get(..packet.caplen as usize) else {
                return Item::Unusable("malformed");
            };
            Item::Packet(Packet {
                time_ns,
                link_type: interface.link_type,
                interface: packet.if_id,
                is_complete: packet.caplen >= packet.origlen,
                bytes,
            })
        }
        Block::SimplePacket(_) => Item::Unusable("without_time"),
        _ => Item::Nothing,
    }
}

fn interface(description: &InterfaceDescriptionBlock<'_>) -> Interface {
    // if_tsresol: a power of 10, or of 2 if the highest bit is set.
    let exponent = u32::from(description.if_tsresol & 0x7f);
    let base: u128 = if description.if_tsresol & 0x80 == 0 { 10 } else { 2 };
    Interface {
        link_type: description.linktype.0,
        units_per_s: base.checked_pow(exponent),
        offset_s: description.if_tsoffset,
    }
}

impl Interface {
    fn time_ns(&self, units: u128) -> Option<u64> {
        let since_offset_ns = (units * u128::from(NS_PER_S)).checked_div(self.units_per_s?)?;
        let offset_ns = i128::from(self.offset_s) * i128::from(NS_PER_S);
        u64::try_from(i128::try_from(since_offset_ns).ok()? + offset_ns).ok()
    }
}

fn fault(error: NomErr<ParseError<&[u8]>>) -> Fault {
    match error {
        NomErr::Incomplete(_) => Fault::Truncated,
        NomErr::Error(error) | NomErr::Failure(error) => match error {
            // These errors contain the rest of the file, which is of no use in a message.
            ParseError::NomError(_, kind) | ParseError::OwnedNomError(_, kind) => {
                Fault::Corrupt(format!("a malformed block ({kind:?})"))
            }
            ParseError::Eof | ParseError::UnexpectedEof | ParseError::Incomplete(_) => Fault::Truncated,
            other => Fault::Corrupt(other.to_string()),
        },
    }
}
