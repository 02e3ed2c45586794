//! Reading whole text files up to a size limit, so that a wrong path or a malicious file does not exhaust the memory.

use std::io::{self, ErrorKind, Read};
use std::path::Path;

use crate::open_regular;

/// Maximum size of a configuration, model or profile, bytes; the largest one written has about 150 000.
pub const TEXT_BYTES_MAX: u64 = 1 << 20;

/// Reads a file of at most `bytes_max` bytes.
///
/// # Errors
/// As [`open_regular`]; [`ErrorKind::FileTooLarge`] for a longer file, [`ErrorKind::InvalidData`] for one that is not
/// UTF-8.
pub fn read_text(path: &Path, bytes_max: u64) -> io::Result<String> {
    let mut text = String::new();
    let read = open_regular(path)?.take(bytes_max + 1).read_to_string(&mut text);
    let longer = || {
        let sentence = format!("it is longer than {bytes_max} bytes, the most that is read of such a file");
        io::Error::new(ErrorKind::FileTooLarge, sentence)
    };
    match read {
        Ok(length) if length as u64 > bytes_max => Err(longer()),
        Ok(_) => Ok(text),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_up_to_its_bound() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.toml");
        std::fs::write(&path, "a = 1\n").unwrap();
        assert_eq!(read_text(&path, 6).unwrap(), "a = 1\n");
        assert_eq!(read_text(&path, 5).unwrap_err().kind(), ErrorKind::FileTooLarge);
        std::fs::write(&path, [0xff, 0xfe]).unwrap();
        assert_eq!(read_text(&path, 6).unwrap_err().kind(), ErrorKind::InvalidData);
    }
}
