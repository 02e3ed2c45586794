//! SHA-256 in the form in which files name each other: 64 lower-case hexadecimal digits.

use std::io::{self, Read};
use std::path::Path;

use sha2::Digest;

use crate::open_regular;

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

/// SHA-256 of a file's bytes.
///
/// # Errors
/// It cannot be read; the message names it.
pub fn sha256_of(path: &Path) -> io::Result<String> {
    sha256_with(path, || {})
}

/// As [`sha256_of`]; `progress` is called before each MiB.
///
/// # Errors
/// As [`sha256_of`].
pub fn sha256_with(path: &Path, mut progress: impl FnMut()) -> io::Result<String> {
    let named =
        |error: io::Error| io::Error::new(error.kind(), format!("cannot read {}: {error}", path.display()));
    let mut hash = Sha256::default();
    let mut file = open_regular(path).map_err(named)?;
    let mut buffer = vec![0; 1 << 20];
    loop {
        progress();
        match file.read(&mut buffer).map_err(named)? {
            0 => return Ok(hash.finish()),
            count => hash.update(&buffer[..count]),
        }
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
