//! Files that the program writes and reads again after a restart: TOML with a format number and a checksum, so that
//! damage by a failing disk, a truncated copy or an editor is detected and the file is refused.

use std::io;
use std::path::Path;

use equipoise_files::{TEXT_BYTES_MAX, read_text};
use serde::de::DeserializeOwned;

use equipoise_files::Sha256;

/// Prefix of the last line, which is a TOML comment.
const CHECKSUM_PREFIX: &str = "# sha256 of all above: ";

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

/// Reads a file of this format; `None` if it does not exist.
///
/// # Errors
/// [`Refusal`].
pub fn read<T: DeserializeOwned>(path: &Path, format: u32) -> Result<Option<T>, Refusal> {
    match read_text(path, TEXT_BYTES_MAX) {
        Ok(text) => parse(&text, format).map(Some).map_err(Refusal::Content),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error.into()),
    }
}

fn parse<T: DeserializeOwned>(text: &str, format: u32) -> Result<T, String> {
    let message = |error: toml::de::Error| error.message().to_owned();
    // Check the format number first: the fields of another format are unknown, and it may have another checksum.
    let table: toml::Table = text.parse().map_err(message)?;
    let found = table.get("format").and_then(toml::Value::as_integer);
    if found != Some(i64::from(format)) {
        let found = found.map_or("missing".to_owned(), |found| found.to_string());
        return Err(format!("its format is {found}, this version reads format {format} only"));
    }
    if !is_checksum_valid(text) {
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

    const FORMAT: u32 = 3;

    fn stored(text: &str) -> String {
        parse::<toml::Table>(text, FORMAT).map_or_else(|reason| reason, |_| "read".to_owned())
    }

    #[test]
    fn any_changed_byte_invalidates_the_checksum() {
        let text = sealed("format = 3\nmass_kg = 71.5\n".to_owned());
        assert_eq!(parse::<toml::Table>(&text, FORMAT).unwrap()["mass_kg"].as_float(), Some(71.5));
        assert_eq!(stored(&text.replace("71.5", "75.1")), stored("format = 3\n"));
        assert!(stored(&text.replace("71.5", "75.1")).contains("checksum"));
        let length_signed = text.trim_end().len();
        for length in 0..length_signed {
            assert_ne!(stored(&text[..length]), "read", "{length} of {length_signed} bytes");
        }
        assert_ne!(stored(&format!("{text}mass_kg = 80.0\n")), "read");
    }

    #[test]
    fn another_format_is_refused_with_and_without_a_checksum() {
        for format in [1, 2, 4] {
            let refusal = format!("its format is {format}, this version reads format 3 only");
            let text = format!("format = {format}\n");
            assert_eq!(stored(&text), refusal);
            assert_eq!(stored(&sealed(text)), refusal);
        }
        assert!(stored("a = 1\n").contains("format is missing"));
        assert!(stored("format = -1\n").contains("-1"));
    }
}
