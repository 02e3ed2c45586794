//! Zenoh keys and liveliness tokens of ROS 2.

use twox_hash::XxHash3_128;

use super::{TYPE_HASH, TYPE_NAME};

/// First part of all liveliness tokens of ROS 2.
const TOKENS: &str = "@ros2_lv";
/// Best effort, volatile, keep last 1; no deadline, lifespan or lease. Empty parts have the defaults of `rmw_zenoh`.
const QOS: &str = "2::,1:,:,:,,";
/// Security enclave "/"; tokens replace `/` in names by `%`.
const ENCLAVE: &str = "%";
/// IDs of node and publisher within the session, which has one of each.
const NODE: u32 = 0;
const PUBLISHER: u32 = 1;

/// Names of a station in the ROS 2 graph: node `/equipoise/STATION/gateway`, topic `/equipoise/STATION/state`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RosNames {
    /// Key of the topic.
    pub topic_key: String,
    /// Liveliness token of the node.
    pub node_token: String,
    /// Liveliness token of the publisher.
    pub publisher_token: String,
}

impl RosNames {
    /// Names of a station in a ROS domain and a Zenoh session.
    pub fn new(station: &str, domain: u32, session_id: &str) -> RosNames {
        let station = ros_name(station);
        let node = format!("{ENCLAVE}/%equipoise%{station}/gateway");
        let start = format!("{TOKENS}/{domain}/{session_id}/{NODE}");
        RosNames {
            topic_key: format!("{domain}/equipoise/{station}/state/{TYPE_NAME}/{TYPE_HASH}"),
            node_token: format!("{start}/{NODE}/NN/{node}"),
            publisher_token: format!(
                "{start}/{PUBLISHER}/MP/{node}/%equipoise%{station}%state/{TYPE_NAME}/{TYPE_HASH}/{QOS}"
            ),
        }
    }

    /// GID of the publisher: XXH3-128 of its token, lower half first.
    pub fn gid(&self) -> [u8; 16] {
        XxHash3_128::oneshot(self.publisher_token.as_bytes()).to_le_bytes()
    }
}

/// The station's name with the characters that ROS 2 allows: letters, digits and `_`, no digit at the front.
pub(super) fn ros_name(station: &str) -> String {
    let plain = station.replace(|letter: char| !letter.is_ascii_alphanumeric(), "_");
    if plain.starts_with(|letter: char| letter.is_ascii_digit()) { format!("_{plain}") } else { plain }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_such_as_ros_allows() {
        assert_eq!(ros_name("station-1"), "station_1");
        assert_eq!(ros_name("3rd"), "_3rd");
    }

    // Parts of a token in the order of liveliness_utils.cpp.
    #[test]
    fn a_publishers_token_has_thirteen_parts_and_none_is_empty() {
        let names = RosNames::new("station-1", 7, "0a1b");
        let parts: Vec<&str> = names.publisher_token.split('/').collect();
        let expected = ["@ros2_lv", "7", "0a1b", "0", "1", "MP", "%", "%equipoise%station_1", "gateway"];
        assert_eq!(parts[..9], expected);
        assert_eq!(parts[9..], ["%equipoise%station_1%state", TYPE_NAME, TYPE_HASH, "2::,1:,:,:,,"]);
        assert_eq!(names.node_token, "@ros2_lv/7/0a1b/0/0/NN/%/%equipoise%station_1/gateway");
        assert_eq!(names.topic_key, format!("7/equipoise/station_1/state/{TYPE_NAME}/{TYPE_HASH}"));
    }

    // XXH3-128 of empty input with seed 0, from the xxHash specification.
    #[test]
    fn a_gid_is_the_lower_half_first() {
        let names =
            RosNames { topic_key: String::new(), node_token: String::new(), publisher_token: String::new() };
        let (high, low) = (0x99aa_06d3_0147_98d8_u64, 0x6001_c324_468d_497f_u64);
        assert_eq!(names.gid()[..8], low.to_le_bytes());
        assert_eq!(names.gid()[8..], high.to_le_bytes());
    }
}
