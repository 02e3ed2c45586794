//! Escapes text of devices and other programs for logs and terminals.

use core::fmt::{Display, Formatter, Result, Write};

/// Displays a text in one line of limited length; control characters and those that change the direction or position of
/// the subsequent text are escaped, so that a peer can neither forge a line nor send commands to a terminal.
#[derive(Debug, Clone, Copy)]
pub struct Printable<'a> {
    /// The peer's text.
    pub text: &'a str,
    /// Maximum number of characters displayed; `…` replaces the rest.
    pub chars_max: usize,
}

impl Display for Printable<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        for (index, sign) in self.text.chars().enumerate() {
            if index == self.chars_max {
                return f.write_char('…');
            }
            if sign.is_control() || is_format(sign) {
                write!(f, "{}", sign.escape_default())?;
            } else {
                f.write_char(sign)?;
            }
        }
        Ok(())
    }
}

/// Zero-width and bidirectional characters, line and paragraph separators (Unicode, chapter 23.2 and UAX #9).
fn is_format(sign: char) -> bool {
    matches!(sign, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::{String, ToString};

    use super::Printable;

    fn escaped(text: &str, chars_max: usize) -> String {
        Printable { text, chars_max }.to_string()
    }

    #[test]
    fn control_characters_are_escaped() {
        assert_eq!(
            escaped("a\nb\r\u{1b}[31mred\u{9b}\u{202e}", 100),
            "a\\nb\\r\\u{1b}[31mred\\u{9b}\\u{202e}"
        );
        assert_eq!(escaped("Plattenmaß 5 µm — gut", 100), "Plattenmaß 5 µm — gut");
    }

    #[test]
    fn a_long_text_is_cut() {
        assert_eq!(escaped("abcdef", 6), "abcdef");
        assert_eq!(escaped("abcdefg", 6), "abcdef…");
    }
}
