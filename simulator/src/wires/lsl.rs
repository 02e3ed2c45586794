//! The Lab Streaming Layer: discovery (UDP), clock queries (UDP), and the samples (TCP), protocol 1.10.
//!
//! After the sources of `liblsl`: `udp_server`, `tcp_server`, `sample` and `stream_info_impl`.

/// Port of discovery queries.
pub const DISCOVERY_PORT: u16 = 16_571;
/// Service ports of the outlets of each computer.
pub const SERVICE_PORTS: core::ops::Range<u16> = 16_572..16_604;
/// The tag of a sample with a time; one without is 1.
const TAG_TIMED: u8 = 2;
/// Timestamp of the test samples.
const TEST_TIME: f64 = 123_456.789;

/// Description of a stream.
#[derive(Debug, Clone, PartialEq)]
pub struct Info {
    /// Name of the stream.
    pub name: String,
    /// Its content type.
    pub kind: String,
    /// Label and unit of each channel.
    pub channels: Vec<(String, String)>,
    /// Samples a second; 0 for an irregular rate.
    pub rate_hz: f64,
    /// Identifies this outlet, whatever its stream's name.
    pub uid: String,
    /// TCP port of the samples, UDP port of the clock.
    pub ports: [u16; 2],
}

/// Number format of `liblsl`: 16 significant digits.
fn number(value: f64) -> String {
    let whole = format!("{value:.0}").len();
    format!("{value:.*}", 16_usize.saturating_sub(whole))
}

impl Info {
    /// The XML, with (`full`) or without the channel descriptions.
    pub fn to_xml(&self, full: bool) -> String {
        let mut xml = String::from("<?xml version=\"1.0\"?>\n<info>\n");
        let mut tag = |name: &str, value: &str| xml += &format!("\t<{name}>{value}</{name}>\n");
        tag("name", &self.name);
        tag("type", &self.kind);
        tag("channel_count", &self.channels.len().to_string());
        tag("channel_format", "float32");
        tag("source_id", &self.name);
        tag("nominal_srate", &number(self.rate_hz));
        tag("version", &number(1.1));
        tag("created_at", &number(1.0));
        tag("uid", &self.uid);
        tag("session_id", "default");
        tag("hostname", "simulated");
        tag("v4address", "");
        tag("v4data_port", &self.ports[0].to_string());
        tag("v4service_port", &self.ports[1].to_string());
        tag("v6address", "");
        tag("v6data_port", "0");
        tag("v6service_port", "0");
        if full {
            xml += "\t<desc>\n\t\t<channels>\n";
            for (label, unit) in &self.channels {
                xml += &format!(
                    "\t\t\t<channel>\n\t\t\t\t<label>{label}</label>\n\t\t\t\t<unit>{unit}</unit>\n\t\t\t</channel>\n"
                );
            }
            xml += "\t\t</channels>\n\t</desc>\n</info>\n";
        } else {
            xml += "\t<desc />\n</info>\n";
        }
        xml
    }

    /// Whether a query matches this stream: `name='Plate' and type='Force'`. Terms other than equalities do not match.
    pub fn matches(&self, query: &str) -> bool {
        query.trim().is_empty()
            || query.split(" and ").all(|term| {
                let Some((key, value)) = term.split_once('=') else { return false };
                let value = value.trim().trim_matches(['\'', '"']);
                match key.trim() {
                    "name" | "source_id" => value == self.name,
                    "type" => value == self.kind,
                    "uid" => value == self.uid,
                    "session_id" => value == "default",
                    "hostname" => value == "simulated",
                    "channel_count" => value.parse() == Ok(self.channels.len()),
                    _ => false,
                }
            })
    }
}

/// UDP queries.
#[derive(Debug, Clone, PartialEq)]
pub enum Question {
    /// Query for streams. The answer goes to this port of the sender.
    ShortInfo {
        /// The query.
        query: String,
        /// The port to answer to.
        port: u16,
        /// Returned with the answer.
        id: String,
    },
    /// Clock query.
    Time {
        /// Returned with the answer.
        wave: i64,
        /// Send time, on the client's clock; returned.
        sent_s: f64,
    },
}

/// Parses a datagram.
pub fn question(bytes: &[u8]) -> Option<Question> {
    let text = core::str::from_utf8(bytes).ok()?;
    let mut lines = text.lines();
    match lines.next()?.trim() {
        "LSL:shortinfo" => {
            let query = lines.next()?.trim().to_owned();
            let rest = lines.collect::<Vec<_>>().join(" ");
            let mut words = rest.split_whitespace();
            let port = words.next()?.parse().ok()?;
            Some(Question::ShortInfo { query, port, id: words.next()?.to_owned() })
        }
        "LSL:timedata" => {
            let rest = lines.collect::<Vec<_>>().join(" ");
            let mut words = rest.split_whitespace();
            Some(Question::Time { wave: words.next()?.parse().ok()?, sent_s: words.next()?.parse().ok()? })
        }
        _ => None,
    }
}

/// The answer to a discovery query.
pub fn short_info(id: &str, info: &Info) -> Vec<u8> {
    format!("{id}\r\n{}", info.to_xml(false)).into_bytes()
}

/// The answer to a clock query: send time (client), receive and answer times (outlet), s.
pub fn time_data(wave: i64, sent_s: f64, heard_s: f64, answered_s: f64) -> Vec<u8> {
    format!(" {wave} {} {} {}", number(sent_s), number(heard_s), number(answered_s)).into_bytes()
}

/// A client's TCP request: complete, including its length.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// The full stream information.
    FullInfo,
    /// The short information, if the query matches.
    ShortInfo(String),
    /// The samples of this outlet (empty: any).
    Feed {
        /// The client's protocol version, for example 110.
        version: u32,
        /// Identifier of the outlet.
        uid: String,
        /// 4321 if the client is big-endian.
        byte_order: u32,
    },
    /// Something else.
    Unknown,
}

/// Removes a request from the received bytes; `None` while it is incomplete.
pub fn take_request(bytes: &mut Vec<u8>) -> Option<Request> {
    let text = String::from_utf8_lossy(bytes).into_owned();
    let (first, rest) = text.split_once("\r\n")?;
    if first.trim() == "LSL:fullinfo" {
        bytes.drain(..first.len() + 2);
        return Some(Request::FullInfo);
    }
    if first.trim() == "LSL:shortinfo" {
        let (query, _) = rest.split_once("\r\n")?;
        bytes.drain(..first.len() + query.len() + 4);
        return Some(Request::ShortInfo(query.trim().to_owned()));
    }
    let Some(feed) = first.strip_prefix("LSL:streamfeed/") else {
        bytes.clear();
        return Some(Request::Unknown);
    };
    let end = text.find("\r\n\r\n")?;
    let mut words = feed.split_whitespace();
    let version = words.next().and_then(|word| word.parse().ok()).unwrap_or(0);
    let uid = words.next().unwrap_or_default().to_owned();
    let byte_order = text[..end]
        .lines()
        .filter_map(|line| line.split_once(':'))
        .find(|(key, _)| key.trim().eq_ignore_ascii_case("native-byte-order"))
        .and_then(|(_, value)| value.trim().parse().ok());
    bytes.drain(..end + 4);
    Some(Request::Feed { version, uid, byte_order: byte_order.unwrap_or(1234) })
}

/// The outlet's answer to a request for samples: headers, then two test samples.
pub fn feed_header(info: &Info) -> Vec<u8> {
    let mut bytes = format!(
        "LSL/110 200 OK\r\nUID: {}\r\nByte-Order: 1234\r\nSuppress-Subnormals: 0\r\nData-Protocol-Version: 110\r\n\r\n",
        info.uid
    )
    .into_bytes();
    for offset in [4, 2] {
        let values: Vec<f32> = (0..info.channels.len())
            .map(|channel| {
                let value = (channel + offset) as f32;
                if channel % 2 == 0 { value } else { -value }
            })
            .collect();
        bytes.extend(sample(TEST_TIME, &values));
    }
    bytes
}

/// A sample with its time on the outlet's clock, s.
pub fn sample(time_s: f64, values: &[f32]) -> Vec<u8> {
    let mut bytes = vec![TAG_TIMED];
    bytes.extend_from_slice(&time_s.to_le_bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info() -> Info {
        let channels = ["Fx1", "Fy1", "Fz1"].map(|label| (label.to_owned(), "N".to_owned()));
        Info {
            name: "Plate".into(),
            kind: "Force".into(),
            channels: channels.into(),
            rate_hz: 100.0,
            uid: "abc".into(),
            ports: [16_573, 16_572],
        }
    }

    #[test]
    fn questions_are_understood_and_answered() {
        let asked = question(b"LSL:shortinfo\r\nsession_id='default' and type='Force'\r\n40001 77\r\n");
        let Some(Question::ShortInfo { query, port: 40_001, id }) = asked else { panic!("{asked:?}") };
        assert!(info().matches(&query) && !info().matches("type='EEG'") && info().matches(""));
        let answer = String::from_utf8(short_info(&id, &info())).unwrap();
        assert!(answer.starts_with("77\r\n<?xml"));
        for part in ["<nominal_srate>100.0000000000000</nominal_srate>", "<v4data_port>16573</v4data_port>"] {
            assert!(answer.contains(part), "{answer}");
        }
        assert_eq!(question(b"LSL:timedata\r\n3 12.5\r\n"), Some(Question::Time { wave: 3, sent_s: 12.5 }));
        assert!(time_data(3, 12.5, 1.0, 2.0).starts_with(b" 3 12.5"));
    }

    #[test]
    fn a_feed_begins_with_headers_and_two_test_samples() {
        let mut sent = b"LSL:streamfeed/110 abc\r\nNative-Byte-Order: 1234\r\n".to_vec();
        assert_eq!(take_request(&mut sent), None);
        sent.extend_from_slice(b"Value-Size: 4\r\n\r\nmore");
        let feed = Request::Feed { version: 110, uid: "abc".into(), byte_order: 1234 };
        assert_eq!((take_request(&mut sent), sent), (Some(feed), b"more".to_vec()));
        let header = feed_header(&info());
        let at = header.windows(4).position(|four| four == b"\r\n\r\n").unwrap() + 4;
        assert_eq!(header[at..].len(), 2 * (1 + 8 + 3 * 4));
        assert_eq!(header[at + 9..at + 21], [4.0_f32, -5.0, 6.0].map(f32::to_le_bytes).concat()[..]);
    }
}
