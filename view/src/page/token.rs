//! The secret that requests must contain if the page can be reached from other machines.

use std::fmt;

use sha2::{Digest, Sha256};

/// Minimum length of a token; 32 hexadecimal digits from `equipoise token` are 128 bits.
pub const TOKEN_CHARS_MIN: usize = 32;
/// Maximum length of a token.
pub const TOKEN_CHARS_MAX: usize = 256;
/// A secret that is only compared. Stored as digests; neither its `Debug` nor any other output reveals it.
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
    /// Creates a token; `None` if the text is too short, too long, or has characters that a URL does not allow.
    pub fn new(text: &str) -> Option<Token> {
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
        if !(TOKEN_CHARS_MIN..=TOKEN_CHARS_MAX).contains(&text.len()) || !text.bytes().all(plain) {
            return None;
        }
        // The cookie differs from the token: it opens this page only, and no other service that shares the secret.
        let cookie = digest(format!("equipoise page cookie\n{text}").as_bytes());
        Some(Token { secret: digest(text.as_bytes()), cookie })
    }

    /// Whether both tokens have the same secret, and therefore do not separate two permissions.
    pub fn is_the_same_as(&self, other: &Token) -> bool {
        same(&self.secret, &other.secret)
    }

    /// Whether `given` is the token.
    pub(super) fn is_secret(&self, given: &str) -> bool {
        same(&digest(given.as_bytes()), &self.secret)
    }

    /// Whether `given` is the cookie.
    pub(super) fn is_cookie(&self, given: &str) -> bool {
        same(&digest(given.as_bytes()), &digest(self.cookie_value().as_bytes()))
    }

    /// Value of the cookie, which replaces the token in the browser.
    pub(super) fn cookie_value(&self) -> String {
        self.cookie.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

fn digest(bytes: &[u8]) -> [u8; 32] {
    Sha256::digest(bytes).into()
}

/// Compares in constant time. Even without that, comparing digests would not reveal how much of a guess was right.
fn same(a: &[u8; 32], b: &[u8; 32]) -> bool {
    let differing = a.iter().zip(b).fold(0, |differing, (a, b)| differing | (a ^ b));
    std::hint::black_box(differing) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECRET: &str = "0123456789abcdefghijklmnopqrstuv";

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
    fn debug_output_hides_the_token() {
        let shown = format!("{:?}", Token::new(SECRET).unwrap());
        assert_eq!(shown, "Token(not shown)");
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
        }
        assert!(Token::new(&format!("{SECRET}\nsecond line")).is_none());
        assert!(Token::new(&"a".repeat(TOKEN_CHARS_MAX)).is_some());
    }
}
