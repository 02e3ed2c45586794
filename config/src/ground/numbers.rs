//! Numbers in descriptions: names, scales, units of time, counter moduli.

use core::fmt;

use equipoise_adapters::wire::text_line::Unit;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::description_error::DescriptionError;

/// A number that a device sends: a name or a table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NamedNumber {
    /// Its name.
    pub name: String,
    /// The channel is `scale × number + offset`.
    pub scale: f64,
    /// As above.
    pub offset: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    name: String,
    #[serde(default = "one")]
    scale: f64,
    #[serde(default)]
    offset: f64,
}

/// From femto to peta: no device has a unit beyond.
const FACTOR_MIN: f64 = 1e-15;
const FACTOR_MAX: f64 = 1e15;
/// Ranges of [`is_factor`] and [`is_summand`], for errors.
pub(super) const FACTORS: &str = "between 1e-15 and 1e15, or the same below zero";
/// As above.
pub(super) const SUMMANDS: &str = "between -1e15 and 1e15";

/// Whether a number may multiply or divide a channel.
pub(super) fn is_factor(number: f64) -> bool {
    (FACTOR_MIN..=FACTOR_MAX).contains(&number.abs())
}

/// Whether a number may be added to a channel, or be an entry of a matrix, which may be zero.
pub(super) fn is_summand(number: f64) -> bool {
    number.abs() <= FACTOR_MAX
}

pub(super) fn one() -> f64 {
    1.0
}

impl<'de> Deserialize<'de> for NamedNumber {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<NamedNumber, D::Error> {
        deserializer.deserialize_any(NameOrTable)
    }
}

struct NameOrTable;

impl<'de> Visitor<'de> for NameOrTable {
    type Value = NamedNumber;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a name, or a table with name, scale and offset")
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<NamedNumber, E> {
        Ok(NamedNumber { name: name.to_owned(), scale: 1.0, offset: 0.0 })
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<NamedNumber, A::Error> {
        let Table { name, scale, offset } = Table::deserialize(MapAccessDeserializer::new(map))?;
        Ok(NamedNumber { name, scale, offset })
    }
}

/// Unit of a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum TimeUnit {
    /// Seconds.
    #[serde(rename = "s")]
    Second,
    /// Milliseconds.
    #[serde(rename = "ms")]
    Millisecond,
    /// Microseconds.
    #[serde(rename = "us")]
    Microsecond,
    /// Nanoseconds.
    #[serde(rename = "ns")]
    Nanosecond,
}

impl TimeUnit {
    /// Converts a number in a text.
    pub(super) fn in_text(self) -> Unit {
        match self {
            TimeUnit::Second => Unit::NanosecondInSeconds,
            TimeUnit::Millisecond => Unit::NanosecondInMilliseconds,
            TimeUnit::Microsecond => Unit::NanosecondInMicroseconds,
            TimeUnit::Nanosecond => Unit::One,
        }
    }

    /// One unit in ns.
    pub(super) fn ns(self) -> u64 {
        match self {
            TimeUnit::Second => 1_000_000_000,
            TimeUnit::Millisecond => 1_000_000,
            TimeUnit::Microsecond => 1000,
            TimeUnit::Nanosecond => 1,
        }
    }
}

/// Value at which a counter wraps to zero; 0 for never.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ModulusConfig(pub u64);

impl ModulusConfig {
    /// Modulus of a counter with this number of bits, at most 64.
    pub(super) fn of_bits(bits: u32) -> u128 {
        1 << bits.clamp(1, 64)
    }

    /// The adapters' representation.
    pub(super) fn checked(self, key: &str) -> Result<u128, DescriptionError> {
        match self.0 {
            0 => Ok(1 << 64),
            1..=15 => Err(DescriptionError::new(
                key,
                format!("a count that starts again at {} reveals no loss; leave it out", self.0),
            )),
            modulus => Ok(u128::from(modulus)),
        }
    }

    /// As [`ModulusConfig::checked`], for a counter with this number of bits: with a larger modulus each wrap would be a
    /// step back.
    pub(super) fn checked_of_bits(self, key: &str, bits: u32) -> Result<u128, DescriptionError> {
        let (modulus, most) = (self.checked(key)?, ModulusConfig::of_bits(bits));
        if modulus <= most {
            return Ok(modulus);
        }
        let what = format!("a {bits}-bit counter wraps at {most}; omit `modulus` or reduce it");
        Err(DescriptionError::new(key, what))
    }
}

/// Bytes in hexadecimal digits, two for each, optionally separated by spaces.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Hex(Vec<u8>);

impl Hex {
    /// Whether there are no bytes.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl core::ops::Deref for Hex {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0
    }
}

impl Serialize for Hex {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let digits: Vec<String> = self.0.iter().map(|byte| format!("{byte:02x}")).collect();
        serializer.serialize_str(&digits.join(" "))
    }
}

impl<'de> Deserialize<'de> for Hex {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Hex, D::Error> {
        let text = String::deserialize(deserializer)?;
        let digits: Vec<u32> = text
            .chars()
            .filter(|sign| *sign != ' ')
            .map(|sign| sign.to_digit(16).unwrap_or(u32::MAX))
            .collect();
        if !digits.len().is_multiple_of(2) || digits.contains(&u32::MAX) {
            return Err(D::Error::custom(format!(
                "`{text}` is not two hexadecimal digits for each byte, as \"aa 55\" is"
            )));
        }
        Ok(Hex(digits
            .chunks(2)
            .map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | *digit as u8))
            .collect()))
    }
}

/// Length of a frame: a constant, or a number in the frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum LengthConfig<Type> {
    /// Constant.
    Fixed(usize),
    /// A number in the frame.
    InFrame {
        /// First byte of the number.
        at: i32,
        /// Type of the number.
        #[serde(rename = "type")]
        number: Type,
        /// Number of bytes that the number excludes.
        plus: usize,
        /// Length of the longest frame.
        most: usize,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LengthField<Type> {
    at: i32,
    #[serde(rename = "type")]
    number: Type,
    #[serde(default)]
    plus: usize,
    most: usize,
}

impl<'de, Type: Deserialize<'de>> Deserialize<'de> for LengthConfig<Type> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<LengthConfig<Type>, D::Error> {
        deserializer.deserialize_any(NumberOrTable(core::marker::PhantomData))
    }
}

struct NumberOrTable<Type>(core::marker::PhantomData<Type>);

impl<'de, Type: Deserialize<'de>> Visitor<'de> for NumberOrTable<Type> {
    type Value = LengthConfig<Type>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number of bytes, or a table with at, type, plus and most")
    }

    fn visit_i64<E: Error>(self, bytes: i64) -> Result<LengthConfig<Type>, E> {
        let bytes = usize::try_from(bytes).map_err(|_| E::custom("a frame has no fewer than 0 bytes"))?;
        Ok(LengthConfig::Fixed(bytes))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<LengthConfig<Type>, A::Error> {
        let LengthField { at, number, plus, most } =
            LengthField::deserialize(MapAccessDeserializer::new(map))?;
        Ok(LengthConfig::InFrame { at, number, plus, most })
    }
}
