//! A moment as people write it: `2026-11-21T10:15:00.250Z`.

/// Nanoseconds since 1970 of a moment in UTC, `YYYY-MM-DDThh:mm:ss[.fraction]Z`.
///
/// # Errors
/// What is expected.
pub fn parse(text: &str) -> Result<u64, String> {
    moment(text).ok_or_else(|| format!("{text} is no moment in UTC such as 2026-11-21T10:15:00.250Z"))
}

fn moment(text: &str) -> Option<u64> {
    let (date, time) = text.strip_suffix('Z')?.split_once('T')?;
    let [year, month, day] = three(date, '-')?;
    let (clock, fraction) = time.split_once('.').unwrap_or((time, "0"));
    let [hour, minute, second] = three(clock, ':')?;
    let sound = (1970..2100).contains(&year)
        && (1..=12).contains(&month)
        && (1..=days_in(year, month)).contains(&day)
        && hour < 24
        && minute < 60
        && second < 60;
    if !sound || fraction.len() > 9 || !fraction.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let days_before_year: u64 = (1970..year).map(|year| if is_leap(year) { 366 } else { 365 }).sum();
    let days: u64 = days_before_year + (1..month).map(|month| days_in(year, month)).sum::<u64>() + day - 1;
    let nanoseconds: u64 = format!("{fraction:0<9}").parse().ok()?;
    Some((((days * 24 + hour) * 60 + minute) * 60 + second) * 1_000_000_000 + nanoseconds)
}

fn three(text: &str, separator: char) -> Option<[u64; 3]> {
    let mut parts = text.split(separator).map(|part| part.parse().ok());
    let three = [parts.next()??, parts.next()??, parts.next()??];
    parts.next().is_none().then_some(three)
}

fn is_leap(year: u64) -> bool {
    year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
}

fn days_in(year: u64, month: u64) -> u64 {
    match month {
        2 if is_leap(year) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_other_programs() {
        // `date -u -d … +%s`
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
