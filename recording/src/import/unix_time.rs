//! Parses a time such as `2026-11-21T10:15:00.250Z`.

use jiff::Timestamp;

/// Nanoseconds since 1970 of a time of RFC 3339, `YYYY-MM-DDThh:mm:ss[.fraction]Z`.
///
/// # Errors
/// A description of the expected format.
pub fn parse(text: &str) -> Result<u64, String> {
    text.parse::<Timestamp>()
        .ok()
        .and_then(|time| u64::try_from(time.as_nanosecond()).ok())
        .ok_or_else(|| format!("{text} is no moment in UTC such as 2026-11-21T10:15:00.250Z"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_match_those_of_other_programs() {
        // Reference values of `date -u -d … +%s`.
        assert_eq!(parse("1970-01-01T00:00:00Z"), Ok(0));
        assert_eq!(parse("2024-02-29T23:59:59.5Z"), Ok(1_709_251_199_500_000_000));
        assert_eq!(parse("2026-11-21T10:15:00.250Z"), Ok(1_795_256_100_250_000_000));
        for wrong in [
            "",
            "2026-11-21",
            "2026-02-29T00:00:00Z",
            "2026-11-21T24:00:00Z",
            "2026-11-21T10:15:00",
            "2026-1-1T1:1:1.-5Z",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
