//! Whether a recording is as it was written: its signature, and the hash chain to the files before and after it.

use std::fmt;
use std::path::Path;

use anyhow::{Context, anyhow, ensure};
use equipoise_adapters::recording::{Predecessor, Recording};
use equipoise_core::message::Printable;
use equipoise_files::sha256_of;
use equipoise_files::{TEXT_BYTES_MAX, open_regular, read_text};
use minisign::{ErrorKind, PublicKey, PublicKeyBox, SignatureBox};

use super::signature::{key_id, signature_of};
use super::storage::RecordingStore;

/// Base64 digits of the 64 bytes of a signature.
const SIGNATURE_DIGITS: usize = 88;
const COMMENT_CHARS_MAX: usize = 200;

/// What is established about a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Authenticity {
    signature: Signature,
    previous: Previous,
    /// The following file of the series, and whether its hash of this one matches.
    next: Option<(String, bool)>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Signature {
    Unsigned,
    /// There is none, and it is required.
    Missing {
        expected: String,
    },
    /// There is a signature, and no public key to check it with.
    Unchecked {
        key: String,
    },
    Valid {
        key: String,
    },
    OtherKey {
        key: String,
        expected: String,
    },
    /// Why it does not match.
    Invalid(String),
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Previous {
    /// The recording names none.
    Unnamed,
    /// It names none, and older files of the series are there.
    Broken,
    Matching(String),
    /// Its name, and why.
    Unchecked(String, String),
    /// It is not there, and older files of the series are.
    Missing(String),
    Differs(String),
}

/// Reads a public key of minisign.
///
/// # Errors
/// The file cannot be read or holds no such key.
pub fn read_public_key(path: &Path) -> anyhow::Result<PublicKey> {
    let text = read_text(path, TEXT_BYTES_MAX)
        .with_context(|| format!("cannot read the public key {}", path.display()))?;
    PublicKeyBox::from(text).into_public_key().map_err(|error| {
        anyhow!(
            "{} holds no public key of minisign ({error}): name the file that ends in .pub",
            path.display()
        )
    })
}

impl Authenticity {
    /// Examines a recording, which is read again for it where there is something to compare with. With a public key and
    /// `is_signature_required`, an unsigned one is not valid.
    ///
    /// # Errors
    /// The recording or its signature cannot be read.
    pub fn of(
        path: &Path,
        recording: &Recording,
        public_key: Option<&PublicKey>,
        is_signature_required: bool,
    ) -> anyhow::Result<Authenticity> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let series = RecordingStore::with(path);
        let mut signature = signature(path, &name, public_key)?;
        if let (Signature::Unsigned, Some(key), true) = (&signature, public_key, is_signature_required) {
            signature = Signature::Missing { expected: key_id(key.keynum()) };
        }
        let previous = match &recording.header().previous {
            Some(previous) => check_previous(path, previous, series.as_ref().map(|(store, _)| store)),
            None if series.as_ref().is_some_and(|(store, _)| store.has_before(&name)) => Previous::Broken,
            None => Previous::Unnamed,
        };
        let next = series.and_then(|(store, number)| store.after(number));
        let next = match next
            .and_then(|next| Some((Recording::open(&next).ok()?.header().previous.clone()?, next)))
        {
            Some((link, next)) if link.file == name => {
                let next = next.file_name().unwrap_or_default().to_string_lossy().into_owned();
                Some((next, link.sha256 == sha256_of(path)?))
            }
            _ => None,
        };
        Ok(Authenticity { signature, previous, next })
    }

    /// Whether nothing contradicts the recording, and no file before it is missing.
    pub fn is_valid(&self) -> bool {
        let signed_otherwise =
            matches!(self.signature, Signature::OtherKey { .. } | Signature::Missing { .. });
        self.contradictions().is_empty()
            && !signed_otherwise
            && !matches!(self.previous, Previous::Missing(_))
    }

    /// What shows that this file or one next to it was altered.
    fn contradictions(&self) -> Vec<String> {
        let mut found = Vec::new();
        if let Signature::Invalid(reason) = &self.signature {
            found.push(reason.clone());
        }
        if let Previous::Differs(previous) = &self.previous {
            found.push(format!("{previous} is not the file whose hash this one contains"));
        }
        if let Some((next, false)) = &self.next {
            found.push(format!("it is not the file whose hash {next} contains"));
        }
        found
    }
}

/// One line.
impl fmt::Display for Authenticity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let contradictions = self.contradictions();
        if !contradictions.is_empty() {
            return write!(f, "altered: {}", contradictions.join("; "));
        }
        match &self.signature {
            Signature::Unsigned => f.write_str("unsigned")?,
            Signature::Missing { expected } => {
                write!(f, "not valid: unsigned, while a signature by key {expected} is expected")?;
            }
            Signature::Unchecked { key } => {
                write!(f, "signed by key {key}, not checked: name its public key with --public-key")?;
            }
            Signature::Valid { key } => write!(f, "valid: signed by key {key}")?,
            Signature::OtherKey { key, expected } => {
                write!(f, "not valid: signed by key {key}, which is not the key {expected}")?;
            }
            Signature::Invalid(reason) => f.write_str(reason)?,
        }
        match &self.previous {
            Previous::Unnamed => f.write_str("; no previous file")?,
            Previous::Broken => {
                f.write_str(
                    "; it names no previous file, though older files are present: a hash chain begins here",
                )?;
            }
            Previous::Matching(previous) => write!(f, "; previous file {previous} matches")?,
            Previous::Unchecked(previous, reason) => {
                write!(f, "; previous file {previous} not checked: {reason}")?;
            }
            Previous::Missing(previous) => {
                write!(f, "; previous file {previous} is missing, though older files are present")?;
            }
            Previous::Differs(_) => {}
        }
        match &self.next {
            Some((next, _)) => write!(f, "; next file {next} matches"),
            None => Ok(()),
        }
    }
}

/// Checks the signature next to a recording.
fn signature(path: &Path, name: &str, public_key: Option<&PublicKey>) -> anyhow::Result<Signature> {
    let signature_path = signature_of(path);
    if signature_path.symlink_metadata().is_err() {
        return Ok(Signature::Unsigned);
    }
    let text = read_text(&signature_path, TEXT_BYTES_MAX)
        .with_context(|| format!("cannot read {}", signature_path.display()))?;
    let signature = match parse(&text) {
        Ok(signature) => signature,
        Err(error) => {
            return Ok(Signature::Invalid(format!(
                "{} holds no signature: {error}",
                signature_path.display()
            )));
        }
    };
    let key = key_id(signature.keynum());
    let Some(public_key) = public_key else { return Ok(Signature::Unchecked { key }) };
    let expected = key_id(public_key.keynum());
    if key != expected {
        return Ok(Signature::OtherKey { key, expected });
    }
    let file = open_regular(path).with_context(|| format!("cannot read {}", path.display()))?;
    if let Err(error) = minisign::verify(public_key, &signature, file, true, false, false) {
        return match error.kind() {
            ErrorKind::Verify => Ok(Signature::Invalid(format!("it is not what key {key} signed"))),
            _ => Err(error).with_context(|| format!("cannot read {}", path.display())),
        };
    }
    let comment = signature.trusted_comment().unwrap_or_default();
    let signed_as = comment.split('\t').find_map(|part| part.strip_prefix("file:"));
    match signed_as.filter(|signed_as| *signed_as != name) {
        Some(signed_as) => {
            let signed_as = Printable { text: signed_as, chars_max: COMMENT_CHARS_MAX };
            Ok(Signature::Invalid(format!("it was signed under the name {signed_as}")))
        }
        None => Ok(Signature::Valid { key }),
    }
}

/// `minisign` would index into a short signature of the comment, and read all of a file that was not hashed first.
fn parse(text: &str) -> anyhow::Result<SignatureBox> {
    let digits = text.lines().nth(3).map_or(0, |line| line.trim().len());
    ensure!(digits == SIGNATURE_DIGITS, "the fourth line is not {SIGNATURE_DIGITS} characters long");
    let signature = SignatureBox::from_string(text)?;
    ensure!(signature.is_prehashed(), "it is of a form that current releases of minisign do not make");
    Ok(signature)
}

fn check_previous(path: &Path, previous: &Predecessor, store: Option<&RecordingStore>) -> Previous {
    let (found, name) = (path.with_file_name(&previous.file), previous.file.clone());
    if found.symlink_metadata().is_err() {
        let is_gap = store.is_some_and(|store| store.has_before(&name));
        let absent = "it is not in the folder".to_owned();
        return if is_gap { Previous::Missing(name) } else { Previous::Unchecked(name, absent) };
    }
    match sha256_of(&found) {
        Ok(sha256) if sha256 == previous.sha256 => Previous::Matching(name),
        Ok(_) => Previous::Differs(name),
        Err(error) => Previous::Unchecked(name, format!("{error:#}")),
    }
}
