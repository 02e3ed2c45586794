//! Numbers as text.

/// What stands before the decimals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decimal {
    /// `1.5`
    Point,
    /// `1,5`
    Comma,
}

/// What one of a whole number is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// One of what is counted.
    One,
    /// A nanosecond, told in seconds.
    NanosecondInSeconds,
    /// A nanosecond, told in milliseconds.
    NanosecondInMilliseconds,
    /// A nanosecond, told in microseconds.
    NanosecondInMicroseconds,
}

impl Unit {
    /// So many decimals make a whole.
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

    /// A number; NaN and infinity are numbers here, for whoever takes it to refuse.
    pub(super) fn number(self, text: &str) -> Option<f64> {
        match self {
            Decimal::Point => text.parse().ok(),
            // A point among decimals after a comma groups thousands, or the form is wrong.
            Decimal::Comma if text.contains('.') => None,
            Decimal::Comma => text.replace(',', ".").parse().ok(),
        }
    }

    /// A number not below zero in a finer unit, exact as far as that goes; what is finer still is cut off.
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

    /// The same for `1e3` and the like, as exact as binary numbers are.
    fn rounded(self, text: &str, unit: Unit) -> Option<u64> {
        let fine = self.number(text)? * 10f64.powi(unit.decimals() as i32);
        // The bound is a power of two and thus exact.
        (fine >= 0.0 && fine < 2f64.powi(64)).then_some(fine as u64)
    }
}
