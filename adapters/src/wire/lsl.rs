//! Lab Streaming Layer (LSL): discovery of a stream, its description, and its samples.
//!
//! Source: liblsl's own code (sccn/liblsl, MIT), protocol version 1.10, which every outlet since 2013 supports. Three
//! exchanges: short infos over UDP for discovery, `LSL:fullinfo` over TCP for the description, `LSL:streamfeed` over
//! TCP for the samples.

pub mod feed;
pub mod info;

pub use feed::{Feed, Format, Item, Malformed};
pub use info::{Channel, InfoFault, StreamInfo};

/// Shared port of all outlets for discovery requests.
pub const DISCOVERY_PORT: u16 = 16_571;
/// Each outlet has its own port from this one on …
pub const FIRST_SERVICE_PORT: u16 = 16_572;
/// … in a range of this size.
pub const SERVICE_PORTS: u16 = 32;
/// Multicast groups of all outlets on a network, in liblsl's default configuration.
pub const MULTICAST: [[u8; 4]; 3] = [[224, 0, 0, 1], [224, 0, 0, 183], [239, 255, 172, 215]];
/// Request for the complete description; the answer ends with the connection.
pub const FULL_INFO_REQUEST: &[u8] = b"LSL:fullinfo\r\n";

/// Discovery request for all streams with these properties; each answers to the requester's address and `return_port`,
/// with `id` in front.
pub fn short_info_request(properties: &[(&str, &str)], return_port: u16, id: u32) -> Vec<u8> {
    let each = properties.iter().map(|(name, value)| format!("{name}='{value}'"));
    let query = each.collect::<Vec<_>>().join(" and ");
    format!("LSL:shortinfo\r\n{query}\r\n{return_port} {id}\r\n").into_bytes()
}

/// The stream in an answer with this `id`; `None` for an answer to another request, or no answer.
pub fn short_info_answer(bytes: &[u8], id: u32) -> Option<StreamInfo> {
    let text = core::str::from_utf8(bytes).ok()?;
    let (answered, info) = text.split_once("\r\n")?;
    (answered.trim().parse() == Ok(id)).then_some(())?;
    StreamInfo::parse(info).ok()
}

/// Requested size of the sender's buffer, s …
const BUFFER_S: f64 = 10.0;
/// … and its minimum, samples: an irregular stream has no rate.
const BUFFER_SAMPLES_MIN: f64 = 1000.0;

/// The request for a stream's samples.
pub fn feed_request(info: &StreamInfo) -> Vec<u8> {
    let StreamInfo { uid, hostname, source_id, session_id, format, .. } = info;
    let value_size = format.size();
    // Max-Buffer-Length is in samples, although liblsl's API has seconds; with 0 the sender ends the stream. With
    // Max-Chunk-Length 0 the sender chooses the chunk size.
    let buffer_samples = (BUFFER_S * info.rate_hz).ceil().max(BUFFER_SAMPLES_MIN);
    format!(
        "LSL:streamfeed/110 {uid}\r\nNative-Byte-Order: 1234\r\nEndian-Performance: 0\r\nHas-IEEE754-Floats: 1\r\n\
         Supports-Subnormals: 1\r\nValue-Size: {value_size}\r\nData-Protocol-Version: 110\r\nMax-Buffer-Length: \
         {buffer_samples}\r\nMax-Chunk-Length: 0\r\nHostname: {hostname}\r\nSource-Id: {source_id}\r\nSession-Id: {session_id}\r\n\r\n"
    )
    .into_bytes()
}

#[cfg(test)]
mod tests;
