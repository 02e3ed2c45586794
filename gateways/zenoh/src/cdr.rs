//! Writer for CDR as used by ROS 2: little-endian, version 1 of the encoding, each number aligned to its size, counted
//! from the end of the four header bytes (OMG DDS-RTPS 2.5 §10.5 and DDS-XTypes 1.3 §7.4.1).

/// Encapsulation identifier CDR_LE, and options, none.
const HEAD: [u8; 4] = [0, 1, 0, 0];

/// A message that is being written.
#[derive(Debug, Clone)]
pub struct Cdr {
    bytes: Vec<u8>,
}

impl Default for Cdr {
    fn default() -> Cdr {
        Cdr { bytes: HEAD.to_vec() }
    }
}

impl Cdr {
    /// The message with its header.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }

    fn aligned(&mut self, bytes: &[u8]) {
        let body = self.bytes.len() - HEAD.len();
        self.bytes.resize(HEAD.len() + body.next_multiple_of(bytes.len()), 0);
        self.bytes.extend_from_slice(bytes);
    }

    /// `bool`
    pub fn bool(&mut self, value: bool) {
        self.u8(u8::from(value));
    }

    /// `uint8`
    pub fn u8(&mut self, value: u8) {
        self.aligned(&[value]);
    }

    /// `int32`
    pub fn i32(&mut self, value: i32) {
        self.aligned(&value.to_le_bytes());
    }

    /// `uint32`
    pub fn u32(&mut self, value: u32) {
        self.aligned(&value.to_le_bytes());
    }

    /// `uint64`
    pub fn u64(&mut self, value: u64) {
        self.aligned(&value.to_le_bytes());
    }

    /// `float64`
    pub fn f64(&mut self, value: f64) {
        self.aligned(&value.to_le_bytes());
    }

    /// `string`: the length includes the terminating zero.
    pub fn string(&mut self, text: &str) {
        self.length(text.len() + 1);
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.push(0);
    }

    /// `float64[N]`, without length prefix.
    pub fn array<const N: usize>(&mut self, values: [f64; N]) {
        values.into_iter().for_each(|value| self.f64(value));
    }

    /// A sequence: its length, then each item by `write`.
    pub fn sequence<T>(
        &mut self,
        items: impl ExactSizeIterator<Item = T>,
        mut write: impl FnMut(&mut Cdr, T),
    ) {
        self.length(items.len());
        for item in items {
            write(self, item);
        }
    }

    /// A sequence of at most one item; an absent value is an empty sequence.
    pub fn optional<T>(&mut self, value: Option<T>, write: impl FnMut(&mut Cdr, T)) {
        self.sequence(value.into_iter(), write);
    }

    fn length(&mut self, length: usize) {
        // No sequence of a state approaches 2³² items.
        self.u32(u32::try_from(length).unwrap_or(u32::MAX));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_at_multiples_of_their_size_counted_from_the_end_of_the_head() {
        let mut cdr = Cdr::default();
        cdr.bool(true);
        cdr.u32(0x0403_0201);
        cdr.u8(5);
        cdr.f64(1.0);
        let mut bytes = vec![0, 1, 0, 0, 1, 0, 0, 0, 1, 2, 3, 4, 5, 0, 0, 0, 0, 0, 0, 0];
        bytes.extend(1.0_f64.to_le_bytes());
        assert_eq!(cdr.finish(), bytes);
    }

    #[test]
    fn a_text_is_counted_with_the_zero_at_its_end_and_what_is_absent_is_of_no_length() {
        let mut cdr = Cdr::default();
        cdr.string("on");
        cdr.optional(None::<f64>, Cdr::f64);
        cdr.optional(Some(2), Cdr::u8);
        let bytes = [0, 1, 0, 0, 3, 0, 0, 0, b'o', b'n', 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2];
        assert_eq!(cdr.finish(), bytes);
    }
}
