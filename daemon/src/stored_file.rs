//! Files that the program writes and reads again after a restart: TOML with a format number and a checksum, so that
//! damage by a failing disk, a truncated copy or an editor is detected and the file is refused.

use std::io;
use std::ops::RangeInclusive;
use std::path::Path;

use equipoise_files::{TEXT_BYTES_MAX, read_text};
use serde::de::DeserializeOwned;

use equipoise_files::Sha256;

/// Prefix of the last line, which is a TOML comment.
const CHECKSUM_PREFIX: &str = "# sha256 of all above: ";

/// Format numbers of a kind of file.
#[derive(Debug, Clone)]
pub struct Formats {
    /// Supported formats; the last one is written.
    pub read: RangeInclusive<u32>,
    /// The first format with a checksum.
    pub sealed_since: u32,
}

/// Reasons to refuse a file.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// The file cannot be read.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The content was changed or has another version.
    #[error("{0}")]
    Content(String),
}

/// Appends a checksum to a text as the last line.
pub fn sealed(mut text: String) -> String {
    if !text.ends_with('\n') {
        text.push('\n');
    }
    let seal = format!("{CHECKSUM_PREFIX}{}\n", Sha256::of(text.as_bytes()));
    text + &seal
}

/// Reads a file; `None` if it does not exist.
///
/// # Errors
/// [`Refusal`].
pub fn read<T: DeserializeOwned>(path: &Path, formats: &Formats) -> Result<Option<T>, Refusal> {
    match read_text(path, TEXT_BYTES_MAX) {
        Ok(text) => parse(&text, formats).map(Some).map_err(Refusal::Content),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error.into()),
    }
}

fn parse<T: DeserializeOwned>(text: &str, formats: &Formats) -> Result<T, String> {
    let message = |error: toml::de::Error| error.message().to_owned();
    // Check the format number first: the fields of a later version are unknown.
    let table: toml::Table = text.parse().map_err(message)?;
    let format = table.get("format").and_then(toml::Value::as_integer);
    let version = format.and_then(|format| u32::try_from(format).ok()).filter(|it| formats.read.contains(it));
    let Some(version) = version else {
        let format = format.map_or("missing".to_owned(), |format| format.to_string());
        let (first, last) = (formats.read.start(), formats.read.end());
        return Err(format!("its format is {format}, this version reads {first} to {last}"));
    };
    if version >= formats.sealed_since && !is_checksum_valid(text) {
        return Err(
            "its checksum is not that of its content: it was damaged, cut or changed by hand".to_owned()
        );
    }
    toml::from_str(text).map_err(message)
}

fn is_checksum_valid(text: &str) -> bool {
    text.rfind(CHECKSUM_PREFIX)
        .is_some_and(|at| text[at + CHECKSUM_PREFIX.len()..].trim_end() == Sha256::of(&text.as_bytes()[..at]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORMATS: Formats = Formats { read: 1..=3, sealed_since: 2 };

    fn stored(text: &str) -> String {
        parse::<toml::Table>(text, &FORMATS).map_or_else(|reason| reason, |_| "read".to_owned())
    }

    #[test]
    fn any_changed_byte_invalidates_the_checksum() {
        let text = sealed("format = 2\nmass_kg = 71.5\n".to_owned());
        assert_eq!(parse::<toml::Table>(&text, &FORMATS).unwrap()["mass_kg"].as_float(), Some(71.5));
        assert_eq!(stored(&text.replace("71.5", "75.1")), stored("format = 2\n"));
        assert!(stored(&text.replace("71.5", "75.1")).contains("checksum"));
        let length_signed = text.trim_end().len();
        for length in 0..length_signed {
            assert_ne!(stored(&text[..length]), "read", "{length} of {length_signed} bytes");
        }
        assert_ne!(stored(&format!("{text}mass_kg = 80.0\n")), "read");
    }

    #[test]
    fn files_without_checksum_are_read_and_a_later_format_is_reported_first() {
        assert_eq!(stored("format = 1\n"), "read");
        assert_eq!(stored("format = 4\n"), "its format is 4, this version reads 1 to 3");
        assert!(stored("a = 1\n").contains("format is missing"));
        assert!(stored("format = -1\n").contains("-1"));
    }
}
