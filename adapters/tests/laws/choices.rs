//! Interprets arbitrary bytes as a sequence of choices for a property test.

/// Reads choices from the front; after the end, all further ones are zero.
#[derive(Debug, Clone)]
pub(crate) struct Choices<'a> {
    bytes: &'a [u8],
}

impl<'a> Choices<'a> {
    /// Uses all bytes as choices.
    pub(crate) fn new(bytes: &'a [u8]) -> Choices<'a> {
        Choices { bytes }
    }

    /// Whether no bytes remain.
    pub(crate) fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The remaining bytes.
    pub(crate) fn rest(&mut self) -> &'a [u8] {
        std::mem::take(&mut self.bytes)
    }

    /// This many bytes, or as many as remain.
    pub(crate) fn take(&mut self, count: usize) -> &'a [u8] {
        let (taken, rest) = self.bytes.split_at(count.min(self.bytes.len()));
        self.bytes = rest;
        taken
    }

    /// A byte.
    pub(crate) fn byte(&mut self) -> u8 {
        self.array::<1>()[0]
    }

    /// Two bytes as a number.
    pub(crate) fn small(&mut self) -> u16 {
        u16::from_le_bytes(self.array())
    }

    /// Eight bytes as a number.
    pub(crate) fn large(&mut self) -> u64 {
        u64::from_le_bytes(self.array())
    }

    /// Eight bytes as any floating-point number.
    pub(crate) fn real(&mut self) -> f64 {
        f64::from_bits(self.large())
    }

    fn array<const N: usize>(&mut self) -> [u8; N] {
        let mut array = [0; N];
        let taken = self.take(N);
        array[..taken.len()].copy_from_slice(taken);
        array
    }
}

/// The bytes in pieces with chosen lengths.
pub(crate) fn pieces<'a>(stream: &'a [u8], lengths: &'a [u8]) -> impl Iterator<Item = &'a [u8]> {
    let mut lengths = lengths.iter().cycle();
    let mut rest = stream;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        // Lengths of 1 to 128, or the whole rest if there are no choices.
        let length = lengths.next().map_or(rest.len(), |length| usize::from(length & 0x7f) + 1);
        let (piece, more) = rest.split_at(length.min(rest.len()));
        rest = more;
        Some(piece)
    })
}
