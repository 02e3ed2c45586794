//! SHA-256 in the form in which files name each other: 64 lower-case hexadecimal digits.

use sha2::Digest;

/// The SHA-256 of bytes that arrive in parts.
#[derive(Debug, Clone, Default)]
pub struct Sha256(sha2::Sha256);

impl Sha256 {
    /// The SHA-256 of these bytes.
    pub fn of(bytes: &[u8]) -> String {
        let mut hash = Sha256::default();
        hash.update(bytes);
        hash.finish()
    }

    /// Appends the next bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// The SHA-256 of all bytes so far, 64 hexadecimal digits.
    pub fn finish(self) -> String {
        self.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_values_are_reproduced_in_one_part_and_in_several() {
        // FIPS 180-2, appendix B.1 and B.2.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(Sha256::of(b"abc"), abc);
        let mut hash = Sha256::default();
        hash.update(b"abcdbcdecdefdefgefghfghighij");
        hash.update(b"");
        hash.update(b"hijkijkljklmklmnlmnomnopnopq");
        assert_eq!(hash.finish(), "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
    }
}
