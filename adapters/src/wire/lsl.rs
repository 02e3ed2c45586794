//! The lab streaming layer: how a stream is found, what it says of itself, and its samples.
//!
//! Source: liblsl's own code (sccn/liblsl, MIT), protocol version 1.10, which every outlet since 2013 speaks. Three
//! conversations: short infos over UDP find streams, `LSL:fullinfo` over TCP describes one, `LSL:streamfeed` over TCP
//! carries its samples.

pub mod feed;
pub mod info;

pub use feed::{Feed, Format, Item, Malformed};
pub use info::{Channel, InfoFault, StreamInfo};

/// Outlets that are asked by everybody listen here.
pub const DISCOVERY_PORT: u16 = 16_571;
/// Each outlet has one of these for itself, from …
pub const FIRST_SERVICE_PORT: u16 = 16_572;
/// … so many.
pub const SERVICE_PORTS: u16 = 32;
/// Where all outlets of a network hear, in the usual setting of liblsl.
pub const MULTICAST: [[u8; 4]; 3] = [[224, 0, 0, 1], [224, 0, 0, 183], [239, 255, 172, 215]];
/// The request for everything a stream says of itself; the answer ends with the connection.
pub const FULL_INFO_REQUEST: &[u8] = b"LSL:fullinfo\r\n";

/// A question for all streams that have these properties; each answers to the asker's address and `return_port`, with
/// `id` in front.
pub fn short_info_request(properties: &[(&str, &str)], return_port: u16, id: u32) -> Vec<u8> {
    let each = properties.iter().map(|(name, value)| format!("{name}='{value}'"));
    let query = each.collect::<Vec<_>>().join(" and ");
    format!("LSL:shortinfo\r\n{query}\r\n{return_port} {id}\r\n").into_bytes()
}

/// The stream that answers a question with this `id`; `None` if it is the answer to another one, or none.
pub fn short_info_answer(bytes: &[u8], id: u32) -> Option<StreamInfo> {
    let text = core::str::from_utf8(bytes).ok()?;
    let (answered, info) = text.split_once("\r\n")?;
    (answered.trim().parse() == Ok(id)).then_some(())?;
    StreamInfo::parse(info).ok()
}

/// The request for a stream's samples.
pub fn feed_request(info: &StreamInfo) -> Vec<u8> {
    let StreamInfo { uid, hostname, source_id, session_id, format, .. } = info;
    let value_size = format.size();
    // Samples wait at the sender for ten seconds at most, and come as the sender likes.
    format!(
        "LSL:streamfeed/110 {uid}\r\nNative-Byte-Order: 1234\r\nEndian-Performance: 0\r\nHas-IEEE754-Floats: 1\r\n\
         Supports-Subnormals: 1\r\nValue-Size: {value_size}\r\nData-Protocol-Version: 110\r\nMax-Buffer-Length: \
         10\r\nMax-Chunk-Length: 0\r\nHostname: {hostname}\r\nSource-Id: {source_id}\r\nSession-Id: {session_id}\r\n\r\n"
    )
    .into_bytes()
}

#[cfg(test)]
mod tests;
