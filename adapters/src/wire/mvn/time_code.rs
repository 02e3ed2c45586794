//! Type 25: the time of day of the sending computer (MVN protocol, "Time code").
//!
//! Twelve characters, `HH:MM:SS.mmm`, UTC, without a date; bare in the specification, after an i32 length in real
//! datagrams. Both are read, the second is written.

use super::Malformed;
use super::header::{DatagramType, Header, Oversized, frame};
use crate::wire::reader::{Reader, write_text};

const MS_PER_DAY: u32 = 86_400_000;

/// Milliseconds since midnight UTC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeCode {
    /// In 0..86 400 000.
    pub time_of_day_ms: u32,
}

impl TimeCode {
    pub(super) fn parse(payload: &[u8]) -> Result<Self, Malformed> {
        let unreadable = Malformed::Text { datagram_type: DatagramType::TIME_CODE, field: "time" };
        // A bare time begins with a digit, a small length with zero.
        let text = if payload.first().is_some_and(u8::is_ascii_digit) {
            core::str::from_utf8(payload).map_err(|_| unreadable)?
        } else {
            let mut reader = Reader::new(payload);
            let text = reader.text().map_err(|_| unreadable)?;
            if !reader.is_empty() {
                return Err(Malformed::Content { datagram_type: DatagramType::TIME_CODE, field: "length" });
            }
            text
        };
        TimeCode::from_text(text).ok_or(unreadable)
    }

    /// Parses `HH:MM:SS` or `HH:MM:SS.mmm`.
    fn from_text(text: &str) -> Option<TimeCode> {
        let (clock, fraction) = text.split_once('.').unwrap_or((text, "000"));
        let mut parts = clock.split(':');
        let hours = digits(parts.next()?, 2, 24)?;
        let minutes = digits(parts.next()?, 2, 60)?;
        let seconds = digits(parts.next()?, 2, 60)?;
        let milliseconds = digits(fraction, 3, 1000)?;
        if parts.next().is_some() {
            return None;
        }
        Some(TimeCode { time_of_day_ms: ((hours * 60 + minutes) * 60 + seconds) * 1000 + milliseconds })
    }
}

fn digits(text: &str, count: usize, limit: u32) -> Option<u32> {
    // `parse` alone would accept a sign.
    if text.len() != count || !text.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    text.parse().ok().filter(|value| *value < limit)
}

impl core::fmt::Display for TimeCode {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let ms = self.time_of_day_ms % MS_PER_DAY;
        let seconds = ms / 1000;
        write!(f, "{:02}:{:02}:{:02}.{:03}", seconds / 3600, seconds / 60 % 60, seconds % 60, ms % 1000)
    }
}

/// Replaces the contents of `out` with one datagram of type 25; times beyond a day wrap.
///
/// # Errors
/// Never; the signature is that of the other types.
pub fn encode(header: &Header, time: TimeCode, out: &mut Vec<u8>) -> Result<(), Oversized> {
    frame(header, DatagramType::TIME_CODE, 1, out, |out| write_text(&time.to_string(), out))
}

// bytes    object
// 0–3      length i32, 12 (absent in the specification)
// 4–15     "HH:MM:SS.mmm"

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mvn::Datagram;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(time_of_day_ms in 0..MS_PER_DAY) {
            let mut bytes = Vec::new();
            encode(&Header::new(1, 4, 0), TimeCode { time_of_day_ms }, &mut bytes).unwrap();
            prop_assert_eq!(bytes.len(), 40);
            let Ok(Datagram::TimeCode(_, read)) = Datagram::parse(&bytes) else { panic!("not read back") };
            prop_assert_eq!(read, TimeCode { time_of_day_ms });
        }
    }

    #[test]
    fn the_bare_form_and_only_times_are_read() {
        assert_eq!(TimeCode::parse(b"15:59:46.272"), Ok(TimeCode { time_of_day_ms: 57_586_272 }));
        assert_eq!(TimeCode::parse(b"\0\0\0\x0815:59:46"), Ok(TimeCode { time_of_day_ms: 57_586_000 }));
        for wrong in
            [&b"24:00:00.000"[..], b"+1:00:00.000", b"15:59:46.27x", b"", b"\0\0\0\x04abcd", b"15:59:46:272"]
        {
            assert!(TimeCode::parse(wrong).is_err(), "{}", wrong.escape_ascii());
        }
    }
}
