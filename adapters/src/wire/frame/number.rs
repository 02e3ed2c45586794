//! Numbers of any width and order of bytes.

use core::ops::Range;

/// In which order the bytes of a number stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Endian {
    /// The lowest first.
    Little,
    /// The highest first.
    Big,
}

impl Endian {
    /// The number that up to eight bytes are.
    pub fn number(self, bytes: &[u8]) -> u64 {
        let joined = |all: u64, byte: &u8| all << 8 | u64::from(*byte);
        match self {
            Endian::Little => bytes.iter().rev().fold(0, joined),
            Endian::Big => bytes.iter().fold(0, joined),
        }
    }
}

/// A kind of number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Number {
    /// 8 bits.
    U8,
    /// 8 bits, signed.
    I8,
    /// 16 bits.
    U16,
    /// 16 bits, signed.
    I16,
    /// 24 bits.
    U24,
    /// 24 bits, signed.
    I24,
    /// 32 bits.
    U32,
    /// 32 bits, signed.
    I32,
    /// 64 bits.
    U64,
    /// 64 bits, signed.
    I64,
    /// IEEE-754 binary32.
    F32,
    /// IEEE-754 binary64.
    F64,
}

impl Number {
    /// How many bytes it takes.
    pub fn bytes(self) -> usize {
        match self {
            Number::U8 | Number::I8 => 1,
            Number::U16 | Number::I16 => 2,
            Number::U24 | Number::I24 => 3,
            Number::U32 | Number::I32 | Number::F32 => 4,
            Number::U64 | Number::I64 | Number::F64 => 8,
        }
    }

    /// Whether it is a whole number without a sign: one that counts, or bits.
    pub fn is_unsigned(self) -> bool {
        matches!(self, Number::U8 | Number::U16 | Number::U24 | Number::U32 | Number::U64)
    }

    fn is_signed(self) -> bool {
        matches!(self, Number::I8 | Number::I16 | Number::I24 | Number::I32 | Number::I64)
    }
}

/// Where a number stands in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Its first byte; below zero counted from the frame's end.
    pub at: i32,
    /// What it is.
    pub number: Number,
    /// In which order its bytes stand.
    pub endian: Endian,
    /// Which of its bits are meant, for numbers without a sign; all of them elsewhere.
    pub mask: u64,
}

impl Place {
    /// A whole number somewhere.
    pub fn new(at: i32, number: Number, endian: Endian) -> Place {
        Place { at, number, endian, mask: u64::MAX }
    }

    /// The same so many bytes farther on.
    pub fn moved(self, bytes: usize) -> Option<Place> {
        let at = self.at.checked_add(i32::try_from(bytes).ok()?)?;
        // From the end it cannot move over the end.
        (self.at >= 0 || at < 0).then_some(Place { at, ..self })
    }

    /// Its bytes in a frame of this length; `None` if they are not all there.
    pub fn range(self, length: usize) -> Option<Range<usize>> {
        let from = index(self.at, length)?;
        let to = from.checked_add(self.number.bytes())?;
        (to <= length).then_some(from..to)
    }

    /// Where it ends, if it is counted from the beginning.
    pub(super) fn end(self, _length: usize) -> Option<usize> {
        usize::try_from(self.at).ok()?.checked_add(self.number.bytes())
    }

    /// Its bits as they stand.
    pub fn raw(self, frame: &[u8]) -> Option<u64> {
        Some(self.endian.number(frame.get(self.range(frame.len())?)?))
    }

    /// The bits that are meant, where they stand.
    pub fn masked(self, frame: &[u8]) -> Option<u64> {
        Some(self.raw(frame)? & self.mask)
    }

    /// The bits that are meant as a number of their own: those in the middle of a word count from one.
    pub fn count(self, frame: &[u8]) -> Option<u64> {
        // A mask without bits has no lowest one; nothing is meant then.
        Some(self.masked(frame)?.checked_shr(self.mask.trailing_zeros()).unwrap_or(0))
    }

    /// The number.
    pub fn value(self, frame: &[u8]) -> Option<f64> {
        let raw = self.raw(frame)?;
        Some(match self.number {
            Number::F32 => f64::from(f32::from_bits(raw as u32)),
            Number::F64 => f64::from_bits(raw),
            number if number.is_signed() => {
                let above = 64 - 8 * number.bytes() as u32;
                ((raw << above).cast_signed() >> above) as f64
            }
            _ => self.count(frame)? as f64,
        })
    }
}

/// A place that may be counted from the end.
pub(super) fn index(at: i32, length: usize) -> Option<usize> {
    match usize::try_from(at) {
        Ok(at) => Some(at),
        Err(_) => length.checked_sub(at.unsigned_abs() as usize),
    }
}
