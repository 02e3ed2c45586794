//! Numbers as text.

/// Decimal separator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decimal {
    /// `1.5`
    Point,
    /// `1,5`
    Comma,
}

/// Unit of an integer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// A dimensionless count.
    One,
    /// Nanoseconds, from a number in seconds.
    NanosecondInSeconds,
    /// Nanoseconds, from a number in milliseconds.
    NanosecondInMilliseconds,
    /// Nanoseconds, from a number in microseconds.
    NanosecondInMicroseconds,
}

impl Unit {
    /// Count of decimals of one integer unit.
    fn decimals(self) -> usize {
        match self {
            Unit::One => 0,
            Unit::NanosecondInMicroseconds => 3,
            Unit::NanosecondInMilliseconds => 6,
            Unit::NanosecondInSeconds => 9,
        }
    }
}

impl Decimal {
    fn separator(self) -> char {
        match self {
            Decimal::Point => '.',
            Decimal::Comma => ',',
        }
    }

    /// A number; NaN and infinity are accepted here, and refused by the caller.
    pub(super) fn number(self, text: &str) -> Option<f64> {
        match self {
            Decimal::Point => text.parse().ok(),
            // With a decimal comma, a point would be a thousands separator, or the format is wrong.
            Decimal::Comma if text.contains('.') => None,
            Decimal::Comma => text.replace(',', ".").parse().ok(),
        }
    }

    /// A non-negative number in a finer unit, exact to that unit; further decimals are truncated.
    pub(super) fn whole(self, text: &str, unit: Unit) -> Option<u64> {
        let text = text.strip_prefix('+').unwrap_or(text);
        let (whole, decimals) = text.split_once(self.separator()).unwrap_or((text, ""));
        let is_plain = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
        if !is_plain(whole) || !is_plain(decimals) || (whole.is_empty() && decimals.is_empty()) {
            return self.rounded(text, unit);
        }
        let digits =
            whole.bytes().chain(decimals.bytes().chain(core::iter::repeat(b'0')).take(unit.decimals()));
        digits
            .into_iter()
            .try_fold(0u64, |value, digit| value.checked_mul(10)?.checked_add(u64::from(digit - b'0')))
    }

    /// The same for exponent notation such as `1e3`, in double precision.
    fn rounded(self, text: &str, unit: Unit) -> Option<u64> {
        let fine = self.number(text)? * 10f64.powi(unit.decimals() as i32);
        // The bound is a power of two and thus exact.
        (fine >= 0.0 && fine < 2f64.powi(64)).then_some(fine as u64)
    }
}
