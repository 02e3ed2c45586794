//! Encoder of `.tar` archives: the POSIX.1-1988 format (`ustar`), which every `tar` program reads.
//!
//! Each file has a header of 512 bytes, its content, and zeros up to a multiple of 512 bytes; two blocks of zeros end the
//! archive. Numbers are octal text; a length of 8 GiB or more is binary, as GNU tar writes it.

use std::io::{self, Read, Write};

use equipoise_files::atomic_file::MODE;

const BLOCK: usize = 512;
/// Lengths of the fields of a name: itself, and the folders before it.
const NAME_BYTES: usize = 100;
const PREFIX_BYTES: usize = 155;
/// Place of the checksum.
const CHECKSUM: std::ops::Range<usize> = 148..156;

/// Appends a file of `length` bytes; `content` must have as many.
///
/// # Errors
/// The name is too long, or the system's error.
pub(super) fn append(
    archive: &mut impl Write,
    name: &str,
    length: u64,
    content: &mut impl Read,
) -> io::Result<()> {
    archive.write_all(&header(name, length)?)?;
    let copied = io::copy(content, archive)?;
    let padding = copied.next_multiple_of(BLOCK as u64) - copied;
    archive.write_all(&[0; BLOCK][..padding as usize])
}

/// Ends the archive.
///
/// # Errors
/// The system's error.
pub(super) fn finish(archive: &mut impl Write) -> io::Result<()> {
    archive.write_all(&[0; 2 * BLOCK])?;
    archive.flush()
}

fn header(name: &str, length: u64) -> io::Result<[u8; BLOCK]> {
    let mut header = [0; BLOCK];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    let (prefix, name) = split(name).ok_or_else(|| {
        io::Error::new(io::ErrorKind::InvalidInput, "its name is too long for a .tar archive")
    })?;
    put(0, name.as_bytes());
    put(100, format!("{MODE:07o}").as_bytes());
    // User, group and time are not of interest to the person.
    put(108, b"0000000");
    put(116, b"0000000");
    if length < 1 << 33 {
        put(124, format!("{length:011o}").as_bytes());
    } else {
        put(124, &[0x80, 0, 0, 0]);
        put(128, &length.to_be_bytes());
    }
    put(136, b"00000000000");
    put(156, b"0");
    put(257, b"ustar\x0000");
    put(345, prefix.as_bytes());
    // The checksum counts its own field as spaces.
    put(CHECKSUM.start, b"        ");
    let sum: u32 = header.iter().map(|byte| u32::from(*byte)).sum();
    header[CHECKSUM].copy_from_slice(format!("{sum:06o}\0 ").as_bytes());
    Ok(header)
}

/// Splits a name at a slash such that both parts fit.
fn split(name: &str) -> Option<(&str, &str)> {
    if name.len() <= NAME_BYTES {
        return Some(("", name));
    }
    let mut slashes = name.match_indices('/').map(|(at, _)| (&name[..at], &name[at + 1..]));
    slashes.find(|(prefix, rest)| prefix.len() <= PREFIX_BYTES && rest.len() <= NAME_BYTES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_has_the_fields_of_the_standard() {
        let header = header("state/subjects/anon-7.toml", 8 * 64 + 7).unwrap();
        assert!(header.starts_with(b"state/subjects/anon-7.toml\0"));
        assert_eq!((&header[124..136], &header[257..265]), (&b"00000001007\0"[..], &b"ustar\x0000"[..]));
        let mut blank = header;
        blank[CHECKSUM].fill(b' ');
        let sum: u32 = blank.iter().map(|byte| u32::from(*byte)).sum();
        let stored = std::str::from_utf8(&header[148..154]).unwrap();
        assert_eq!(u32::from_str_radix(stored, 8).unwrap(), sum);
        let [marker, .., last] = super::header("a", 1 << 33).unwrap()[124..136] else { panic!("12 bytes") };
        assert_eq!((marker, last), (0x80, 0));
    }

    #[test]
    fn a_long_name_is_split_and_a_longer_one_refused() {
        let long = format!("{}/{}", "a".repeat(120), "b".repeat(90));
        assert_eq!(split(&long), Some((&long[..120], &long[121..])));
        assert_eq!(split(&"a".repeat(101)), None);
        assert!(header(&"a".repeat(101), 1).is_err());
    }

    #[test]
    fn contents_are_padded_and_the_archive_ends_with_two_blocks() {
        let mut archive = Vec::new();
        append(&mut archive, "one", 3, &mut &b"one"[..]).unwrap();
        append(&mut archive, "none", 0, &mut &b""[..]).unwrap();
        finish(&mut archive).unwrap();
        assert_eq!(archive.len(), 5 * BLOCK);
        assert_eq!(&archive[BLOCK..BLOCK + 4], b"one\0");
    }
}
