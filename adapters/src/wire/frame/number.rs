//! Numbers of any width and byte order.

use core::ops::Range;

/// Byte order of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Endian {
    /// Least significant byte first.
    Little,
    /// Most significant byte first.
    Big,
}

impl Endian {
    /// The number of up to eight bytes.
    pub fn number(self, bytes: &[u8]) -> u64 {
        let joined = |all: u64, byte: &u8| all << 8 | u64::from(*byte);
        match self {
            Endian::Little => bytes.iter().rev().fold(0, joined),
            Endian::Big => bytes.iter().fold(0, joined),
        }
    }
}

/// Type of a number.
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
    /// Size in bytes.
    pub fn bytes(self) -> usize {
        match self {
            Number::U8 | Number::I8 => 1,
            Number::U16 | Number::I16 => 2,
            Number::U24 | Number::I24 => 3,
            Number::U32 | Number::I32 | Number::F32 => 4,
            Number::U64 | Number::I64 | Number::F64 => 8,
        }
    }

    /// Whether the type is an unsigned integer, as counters and bit fields are.
    pub fn is_unsigned(self) -> bool {
        matches!(self, Number::U8 | Number::U16 | Number::U24 | Number::U32 | Number::U64)
    }

    fn is_signed(self) -> bool {
        matches!(self, Number::I8 | Number::I16 | Number::I24 | Number::I32 | Number::I64)
    }
}

/// Position of a number in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NumberPosition {
    /// Its first byte; negative values count from the frame's end.
    pub at: i32,
    /// Its type.
    pub number: Number,
    /// Its byte order.
    pub endian: Endian,
    /// Mask of the relevant bits, for unsigned types; all bits for others.
    pub mask: u64,
}

impl NumberPosition {
    /// A number without a mask.
    pub fn new(at: i32, number: Number, endian: Endian) -> NumberPosition {
        NumberPosition { at, number, endian, mask: u64::MAX }
    }

    /// The same, shifted by this many bytes.
    pub fn moved(self, bytes: usize) -> Option<NumberPosition> {
        let at = self.at.checked_add(i32::try_from(bytes).ok()?)?;
        // A position relative to the end cannot move past the end.
        (self.at >= 0 || at < 0).then_some(NumberPosition { at, ..self })
    }

    /// The bytes in a frame of this length; `None` if they are not all in it.
    pub fn range(self, length: usize) -> Option<Range<usize>> {
        let from = index(self.at, length)?;
        let to = from.checked_add(self.number.bytes())?;
        (to <= length).then_some(from..to)
    }

    /// The end, if the position is relative to the beginning.
    pub(super) fn end(self, _length: usize) -> Option<usize> {
        usize::try_from(self.at).ok()?.checked_add(self.number.bytes())
    }

    /// The unmasked bits.
    pub fn raw(self, frame: &[u8]) -> Option<u64> {
        Some(self.endian.number(frame.get(self.range(frame.len())?)?))
    }

    /// The relevant bits, not shifted.
    pub fn masked(self, frame: &[u8]) -> Option<u64> {
        Some(self.raw(frame)? & self.mask)
    }

    /// The relevant bits, shifted to the lowest position.
    pub fn count(self, frame: &[u8]) -> Option<u64> {
        // An empty mask has no lowest bit and gives zero.
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

/// Resolves a position that may be relative to the end.
pub(super) fn index(at: i32, length: usize) -> Option<usize> {
    match usize::try_from(at) {
        Ok(at) => Some(at),
        Err(_) => length.checked_sub(at.unsigned_abs() as usize),
    }
}
