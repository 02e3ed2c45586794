//! Limits the length of lines, for a reader that buffers whole lines.

use std::io::{self, ErrorKind, Read};

/// Maximum length of a line of a CSV, bytes; a row of all columns has some 4000.
pub const LINE_BYTES_MAX: usize = 64 * 1024;

/// Reads until a line exceeds the limit; then it fails, which ends the file.
#[derive(Debug)]
pub struct ShortLines<R> {
    inner: R,
    /// Length of the current line so far.
    line_bytes: usize,
}

impl<R: Read> ShortLines<R> {
    pub(super) fn new(inner: R) -> ShortLines<R> {
        ShortLines { inner, line_bytes: 0 }
    }
}

impl<R: Read> Read for ShortLines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        for piece in buffer[..read].split_inclusive(|byte| *byte == b'\n') {
            self.line_bytes += piece.len();
            if self.line_bytes > LINE_BYTES_MAX {
                let sentence =
                    format!("a line has more than {LINE_BYTES_MAX} bytes: this is no CSV of samples");
                return Err(io::Error::new(ErrorKind::InvalidData, sentence));
            }
            if piece.ends_with(b"\n") {
                self.line_bytes = 0;
            }
        }
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn readable(text: &str) -> bool {
        ShortLines::new(text.as_bytes()).read_to_end(&mut Vec::new()).is_ok()
    }

    #[test]
    fn long_files_are_read_and_long_lines_are_not() {
        let line = format!("{}\n", "a".repeat(LINE_BYTES_MAX - 1));
        assert!(readable(&line.repeat(10)));
        assert!(readable(&format!("{line}b")));
        assert!(!readable(&format!("short\na{line}")));
        assert!(ShortLines::new(io::repeat(b'a')).read_to_end(&mut Vec::new()).is_err(), "it never ends");
    }
}
