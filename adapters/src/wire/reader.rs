//! A cursor over big-endian bytes that returns `None` at the end instead of panicking.

/// Reads numbers from the front of a byte slice; `None` if too few bytes remain.
#[derive(Debug, Clone, Copy)]
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Reader { rest: bytes }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    pub(crate) fn remaining(&self) -> usize {
        self.rest.len()
    }

    pub(crate) fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.rest.split_first_chunk::<N>()?;
        self.rest = rest;
        Some(*head)
    }

    pub(crate) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(head)
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_be_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_be_bytes)
    }

    pub(crate) fn i32(&mut self) -> Option<i32> {
        self.array().map(i32::from_be_bytes)
    }

    /// `N` consecutive IEEE-754 binary32.
    pub(crate) fn f32s<const N: usize>(&mut self) -> Option<[f32; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f32::from_be_bytes(self.array()?);
        }
        Some(values)
    }

    /// An i32 length, then as many bytes of UTF-8 without a terminator.
    pub(crate) fn text(&mut self) -> Result<&'a str, TextFault> {
        let length = self.i32().ok_or(TextFault::TooShort)?;
        let length = usize::try_from(length).map_err(|_| TextFault::TooShort)?;
        let bytes = self.bytes(length).ok_or(TextFault::TooShort)?;
        core::str::from_utf8(bytes).map_err(|_| TextFault::NotUtf8)
    }
}

/// Why a length-prefixed text could not be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TextFault {
    TooShort,
    NotUtf8,
}

/// Appends big-endian binary32 values.
pub(crate) fn write_f32s(values: &[f32], out: &mut Vec<u8>) {
    for value in values {
        out.extend_from_slice(&value.to_be_bytes());
    }
}

/// Appends an i32 length and the bytes of `text`.
pub(crate) fn write_text(text: &str, out: &mut Vec<u8>) {
    // A text beyond i32::MAX does not fit any datagram; framing refuses it by its size.
    let length = i32::try_from(text.len()).unwrap_or(i32::MAX);
    out.extend_from_slice(&length.to_be_bytes());
    out.extend_from_slice(text.as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_ends_instead_of_panicking() {
        let mut reader = Reader::new(&[0, 0, 0, 9, b'a']);
        assert_eq!(reader.text(), Err(TextFault::TooShort));
        let mut reader = Reader::new(&[0xff, 0xff, 0xff, 0xff]);
        assert_eq!(reader.text(), Err(TextFault::TooShort));
        let mut reader = Reader::new(&[0, 0, 0, 1, 0xff]);
        assert_eq!(reader.text(), Err(TextFault::NotUtf8));
        assert!(reader.is_empty() && reader.u16().is_none() && reader.f32s::<3>().is_none());
    }
}
