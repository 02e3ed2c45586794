//! The secret that a request must bring when the page can be reached from other machines.

use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

/// The fewest characters of a token: with the 16 digits of `equipoise token`, 128 bits.
pub const TOKEN_CHARS_MIN: usize = 32;
/// The most characters of a token.
pub const TOKEN_CHARS_MAX: usize = 256;
/// Permissions a token's file may have at most: owner reads and writes, group reads.
const MODE_MAX: u32 = 0o640;

/// Why a token cannot be used. Its text never holds the token.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The file cannot be read.
    #[error("cannot read the token {path}: {source}; `equipoise token --out {path}` makes one")]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Others than owner and group could read it, or others than the owner write it.
    #[error(
        "the token {path} has mode {mode:04o}: whoever can read it sees the worker; make it 0640 or stricter \
         (chmod 640 {path})"
    )]
    Mode {
        /// Which file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// It is too short, too long, or has characters that an address cannot hold.
    #[error(
        "the token in {path} must be {TOKEN_CHARS_MIN} to {TOKEN_CHARS_MAX} letters, digits, '-', '.', '_' or '~' in one \
         line; `equipoise token` makes one"
    )]
    Content {
        /// Which file.
        path: PathBuf,
    },
}

/// A secret that is only ever compared. Kept as digests; neither its `Debug` nor anything else tells it.
#[derive(Clone, Copy)]
pub struct Token {
    secret: [u8; 32],
    cookie: [u8; 32],
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(not shown)")
    }
}

impl Token {
    /// Reads a file of one line that nobody but owner and group may read.
    ///
    /// # Errors
    /// [`TokenError`].
    pub fn read(path: &Path) -> Result<Token, TokenError> {
        let failed = |source| TokenError::Read { path: path.to_owned(), source };
        let file = File::open(path).map_err(failed)?;
        let mode = file.metadata().map_err(failed)?.permissions().mode() & 0o7777;
        if mode & !MODE_MAX != 0 {
            return Err(TokenError::Mode { path: path.to_owned(), mode });
        }
        let mut text = String::new();
        // Two characters for the end of the line; what is longer is refused without being read.
        let read = file.take(TOKEN_CHARS_MAX as u64 + 3).read_to_string(&mut text);
        if let Err(source) = read.map(drop)
            && source.kind() != io::ErrorKind::InvalidData
        {
            return Err(failed(source));
        }
        Token::new(text.trim_end_matches(['\r', '\n']))
            .ok_or_else(|| TokenError::Content { path: path.to_owned() })
    }

    /// A token of this text; `None` if it is too short, too long, or holds other characters than an address may.
    pub fn new(text: &str) -> Option<Token> {
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
        if !(TOKEN_CHARS_MIN..=TOKEN_CHARS_MAX).contains(&text.len()) || !text.bytes().all(plain) {
            return None;
        }
        // What a browser keeps is not the token: it opens this page and nothing else that may share the secret.
        let cookie = digest(format!("equipoise page cookie\n{text}").as_bytes());
        Some(Token { secret: digest(text.as_bytes()), cookie })
    }

    /// Whether both are one secret: two doors with one key are one door.
    pub fn is_the_same_as(&self, other: &Token) -> bool {
        same(&self.secret, &other.secret)
    }

    /// Whether `given` is the token.
    pub(super) fn is_secret(&self, given: &str) -> bool {
        same(&digest(given.as_bytes()), &self.secret)
    }

    /// Whether `given` is what a browser was told to keep.
    pub(super) fn is_cookie(&self, given: &str) -> bool {
        same(&digest(given.as_bytes()), &digest(self.cookie_value().as_bytes()))
    }

    /// What a browser that brought the token is told to keep in its place.
    pub(super) fn cookie_value(&self) -> String {
        self.cookie.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

fn digest(bytes: &[u8]) -> [u8; 32] {
    Sha256::digest(bytes).into()
}

/// Takes the same time wherever the two differ. That both are digests hides how much of a guess was right even if it
/// did not.
fn same(a: &[u8; 32], b: &[u8; 32]) -> bool {
    let differing = a.iter().zip(b).fold(0, |differing, (a, b)| differing | (a ^ b));
    std::hint::black_box(differing) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECRET: &str = "0123456789abcdefghijklmnopqrstuv";

    fn file(mode: u32, text: &str) -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("page.token");
        std::fs::write(&path, text).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        (directory, path)
    }

    #[test]
    fn only_the_token_is_the_token() {
        let token = Token::new(SECRET).unwrap();
        assert!(token.is_secret(SECRET));
        for wrong in ["", "0", &SECRET[1..], &SECRET.to_uppercase(), &token.cookie_value()] {
            assert!(!token.is_secret(wrong), "{wrong}");
        }
        assert!(token.is_cookie(&token.cookie_value()));
        assert!(!token.is_cookie(SECRET) && !token.is_cookie(""));
        let other = Token::new(&SECRET.replace('0', "1")).unwrap();
        assert!(!token.is_cookie(&other.cookie_value()));
        assert!(token.is_the_same_as(&Token::new(SECRET).unwrap()) && !token.is_the_same_as(&other));
    }

    #[test]
    fn it_is_never_told() {
        let told = format!("{:?}", Token::new(SECRET).unwrap());
        assert_eq!(told, "Token(not shown)");
        let (_directory, path) = file(0o640, &format!("{SECRET}!"));
        let refused = Token::read(&path).unwrap_err();
        assert!(!format!("{refused} {refused:?}").contains(SECRET));
    }

    #[test]
    fn short_long_and_unprintable_ones_are_refused() {
        let long = "a".repeat(TOKEN_CHARS_MAX + 1);
        for wrong in [
            "",
            &SECRET[1..],
            &long,
            "0123456789abcdef 0123456789abcdef",
            "0123456789abcdef&0123456789abcdef",
        ] {
            assert!(Token::new(wrong).is_none(), "{wrong}");
            let (_directory, path) = file(0o600, wrong);
            assert!(matches!(Token::read(&path), Err(TokenError::Content { .. })), "{wrong}");
        }
        let (_directory, path) = file(0o600, &format!("{SECRET}\nsecond line\n"));
        assert!(matches!(Token::read(&path), Err(TokenError::Content { .. })));
        let (_directory, path) = file(0o600, &format!("{}\n", "a".repeat(TOKEN_CHARS_MAX)));
        assert!(Token::read(&path).is_ok());
    }

    #[test]
    fn a_file_that_others_can_read_is_refused() {
        for mode in [0o644, 0o660, 0o604, 0o750, 0o666] {
            let (_directory, path) = file(mode, SECRET);
            let said = Token::read(&path).unwrap_err().to_string();
            assert!(said.contains(&format!("mode {mode:04o}")) && said.contains("chmod 640"), "{said}");
        }
        for mode in [0o640, 0o600, 0o400] {
            let (_directory, path) = file(mode, &format!("{SECRET}\n"));
            assert!(Token::read(&path).unwrap().is_secret(SECRET));
        }
        assert!(matches!(Token::read(Path::new("/nowhere/token")), Err(TokenError::Read { .. })));
    }
}
