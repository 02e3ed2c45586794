//! Packages of RTDE, protocol version 2, as a client of the controller sends and reads them.
//!
//! Source: Universal Robots' "Real-Time Data Exchange (RTDE) Guide". All numbers are big-endian.
//!
//! | package | type | from the client | from the controller |
//! |---|---|---|---|
//! | header | | size of the whole package u16, type u8 | the same |
//! | request protocol version | V | version u16 | accepted u8 |
//! | get controller version | v | | major, minor, bugfix, build u32 |
//! | text message | M | | length u8, message, length u8, source, level u8 |
//! | set up outputs | O | rate f64 (Hz), names, separated by commas | recipe u8 (0: refused), types or `NOT_FOUND` |
//! | set up inputs | I | names, separated by commas | recipe u8 (0: refused), types or `IN_USE`, `NOT_FOUND` |
//! | start | S | | accepted u8 |
//! | data | U | recipe u8, values | the same |

use std::io::{self, Read};

use equipoise_core::message::Printable;

/// Protocol version requested.
pub(super) const PROTOCOL: u16 = 2;
/// Header length in bytes.
const HEADER_BYTES: usize = 3;

/// Package types.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kind {
    /// Request protocol version.
    Protocol = b'V',
    /// Get controller version.
    Version = b'v',
    /// Text message.
    Text = b'M',
    /// Set up outputs.
    Outputs = b'O',
    /// Set up inputs.
    Inputs = b'I',
    /// Start.
    Start = b'S',
    /// Data.
    Data = b'U',
}

/// A value of a register.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Word {
    /// INT32
    Int(i32),
    /// DOUBLE
    Double(f64),
}

/// A package with its header.
pub(super) fn package(kind: Kind, payload: &[u8]) -> Vec<u8> {
    let size = (HEADER_BYTES + payload.len()) as u16;
    [&size.to_be_bytes()[..], &[kind as u8], payload].concat()
}

/// A data package of a recipe.
pub(super) fn data(recipe: u8, words: impl IntoIterator<Item = Word>) -> Vec<u8> {
    let mut payload = vec![recipe];
    for word in words {
        match word {
            Word::Int(value) => payload.extend(value.to_be_bytes()),
            // The controller accepts NaN, but a register must never contain one.
            Word::Double(value) => {
                payload.extend((if value.is_finite() { value } else { 0.0 }).to_be_bytes());
            }
        }
    }
    package(Kind::Data, &payload)
}

/// Reads type and payload of the next package.
///
/// # Errors
/// Read errors of the stream, or an invalid package size.
pub(super) fn read(from: &mut impl Read) -> io::Result<(u8, Vec<u8>)> {
    let mut header = [0; HEADER_BYTES];
    from.read_exact(&mut header)?;
    let size = usize::from(u16::from_be_bytes([header[0], header[1]]));
    let length = size.checked_sub(HEADER_BYTES).ok_or_else(|| {
        io::Error::new(io::ErrorKind::InvalidData, format!("a package of {size} bytes: this is not RTDE"))
    })?;
    let mut payload = vec![0; length];
    from.read_exact(&mut payload)?;
    Ok((header[2], payload))
}

/// Removes the first complete package from `bytes` and returns its type and payload.
pub(super) fn take(bytes: &mut Vec<u8>) -> Option<(u8, Vec<u8>)> {
    let size = usize::from(u16::from_be_bytes([*bytes.first()?, *bytes.get(1)?])).max(HEADER_BYTES);
    if bytes.len() < size {
        return None;
    }
    let package: Vec<u8> = bytes.drain(..size).collect();
    Some((package[2], package[HEADER_BYTES..].to_vec()))
}

/// Message and source of a text, at most 255 bytes each, and `: `.
const TEXT_CHARS_MAX: usize = 512;

/// Source and message of a text package, made printable for the log.
pub(super) fn text(payload: &[u8]) -> String {
    let part = |from: usize| {
        let length = usize::from(payload.get(from).copied().unwrap_or(0));
        let end = (from + 1 + length).min(payload.len());
        (String::from_utf8_lossy(payload.get(from + 1..end).unwrap_or(&[])).into_owned(), end)
    };
    let (message, end) = part(0);
    let (source, _) = part(end);
    let text = if source.is_empty() { message } else { format!("{source}: {message}") };
    Printable { text: &text, chars_max: TEXT_CHARS_MAX }.to_string()
}
