//! Names and metadata by which ROS 2 nodes on `rmw_zenoh` discover and read a station. Source: ros2/rmw_zenoh,
//! docs/design.md, and in rmw_zenoh_cpp/src/detail `liveliness_utils.cpp` (keys, tokens, GID) and
//! `attachment_helpers.cpp`.

mod message;
mod names;

pub use message::state_message;
pub use names::RosNames;

/// DDS type name of the message.
pub const TYPE_NAME: &str = "equipoise_msgs::msg::dds_::State_";
/// SHA-256 of the type description (REP 2016); it changes with any message definition that the type contains.
/// `tests/type_hash.rs` computes it from `clients/ros2/equipoise_msgs/msg`.
pub const TYPE_HASH: &str = "RIHS01_57edcd79bd52c8cf1a38dcf6212c651d707f01f8a2e977dd8097d2a1c52ff8b9";

/// Attachment that `rmw_zenoh` requires with every message: sequence number and source time as little-endian 64-bit
/// integers, then the length and the bytes of the publisher's GID.
pub fn attachment(sequence: u64, now_unix_ns: u64, gid: [u8; 16]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(33);
    bytes.extend_from_slice(&sequence.to_le_bytes());
    bytes.extend_from_slice(&now_unix_ns.to_le_bytes());
    bytes.push(gid.len() as u8);
    bytes.extend_from_slice(&gid);
    bytes
}
