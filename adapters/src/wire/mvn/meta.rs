//! Type 12: properties of the character (MVN protocol, "Character information").
//!
//! Lines of `tag:value`. Observed tags: `name`, `xmid`, `color`, `count`, `timeOffset`.

use super::Malformed;
use super::header::{DatagramType, Header, Oversized, frame};
use crate::wire::reader::{Reader, TextFault, write_text};

/// The text of one datagram, parsed on demand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Meta<'a> {
    text: &'a str,
}

impl<'a> Meta<'a> {
    pub(super) fn parse(payload: &'a [u8]) -> Result<Self, Malformed> {
        let datagram_type = DatagramType::META;
        let mut reader = Reader::new(payload);
        let text = reader.text().map_err(|fault| match fault {
            TextFault::TooShort => Malformed::Content { datagram_type, field: "text length" },
            TextFault::NotUtf8 => Malformed::Text { datagram_type, field: "text" },
        })?;
        if !reader.is_empty() {
            return Err(Malformed::Content { datagram_type, field: "text length" });
        }
        Ok(Meta { text })
    }

    /// All `(tag, value)` pairs in the order of transmission; lines without a colon are omitted.
    pub fn tags(&self) -> impl Iterator<Item = (&'a str, &'a str)> + use<'a> {
        self.text.lines().filter_map(|line| line.trim_end_matches('\r').split_once(':'))
    }

    /// The value of a tag.
    pub fn get(&self, tag: &str) -> Option<&'a str> {
        self.tags().find(|(name, _)| *name == tag).map(|(_, value)| value)
    }

    /// The character's name.
    pub fn name(&self) -> Option<&'a str> {
        self.get("name")
    }

    /// UTC minus the sender's local time, ms.
    pub fn time_offset_ms(&self) -> Option<i64> {
        self.get("timeOffset")?.trim().parse().ok()
    }
}

/// Replaces the contents of `out` with one datagram of type 12.
///
/// # Errors
/// [`Oversized`] if the text is longer than a datagram.
pub fn encode(header: &Header, tags: &[(&str, &str)], out: &mut Vec<u8>) -> Result<(), Oversized> {
    let text: String = tags.iter().map(|(tag, value)| format!("{tag}:{value}\n")).collect();
    frame(header, DatagramType::META, 1, out, |out| write_text(&text, out))
}

// bytes    object
// 0–3      length of the text i32
// 4–       text, UTF-8, no NUL: "tag:value\n" …

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;

    #[test]
    fn what_is_written_is_read() {
        let mut bytes = Vec::new();
        let tags = [("name", "Mira: 2"), ("timeOffset", "-3600000"), ("color", "e96417")];
        encode(&Header::new(1, 0, 0), &tags, &mut bytes).unwrap();
        let Ok(Datagram::Meta(_, meta)) = Datagram::parse(&bytes) else { panic!("not read back") };
        assert_eq!(meta.tags().collect::<Vec<_>>(), tags);
        assert_eq!(
            (meta.name(), meta.time_offset_ms(), meta.get("xmid")),
            (Some("Mira: 2"), Some(-3_600_000), None)
        );
    }

    #[test]
    fn a_length_that_lies_is_refused() {
        assert!(Meta::parse(b"\0\0\0\x05abcd").is_err());
        assert!(Meta::parse(b"\0\0\0\x03abcd").is_err());
        assert!(Meta::parse(b"\0\0\0\x01\xff").is_err());
    }
}
