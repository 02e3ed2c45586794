//! Keys pressed on the terminal, and whether it still exists.
//!
//! Read here and not with crossterm, whose reader retries for ever once the terminal returns end of file or EIO.

use std::io::Stdin;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, read};

/// Bytes read at once: a key, its escape sequence, or a part of a pasted text.
const BYTES_AT_ONCE: usize = 64;
const ESCAPE: u8 = 0x1b;
/// Ctrl-C and Ctrl-D, which are bytes in the terminal's raw mode.
const CONTROL_C: u8 = 0x03;
const CONTROL_D: u8 = 0x04;

/// What the terminal returned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pressed {
    /// No key, or one without a meaning here.
    Nothing,
    /// A key that ends the screen.
    Quit,
    /// `?`.
    Help,
    /// The terminal was closed.
    Gone,
}

/// Waits for a key, at most `patience`.
pub(super) fn wait(stdin: &Stdin, patience: Duration) -> Pressed {
    let timeout = Timespec { tv_sec: patience.as_secs() as i64, tv_nsec: patience.subsec_nanos().into() };
    let mut watched = [PollFd::new(stdin, PollFlags::IN)];
    match poll(&mut watched, Some(&timeout)) {
        Ok(0) | Err(Errno::INTR) => return Pressed::Nothing,
        Ok(_) => {}
        Err(_) => return Pressed::Gone,
    }
    let mut bytes = [0; BYTES_AT_ONCE];
    match read(stdin, &mut bytes) {
        Ok(count @ 1..) => parse_key(bytes.get(..count).unwrap_or_default()),
        Err(Errno::INTR | Errno::AGAIN) => Pressed::Nothing,
        Ok(_) | Err(_) => Pressed::Gone,
    }
}

/// Escape alone is a key; with more bytes it begins the sequence of an arrow, a function key or a mouse.
fn parse_key(bytes: &[u8]) -> Pressed {
    match bytes {
        [ESCAPE] => Pressed::Quit,
        [ESCAPE, ..] => Pressed::Nothing,
        keys if keys.iter().any(|key| matches!(*key, b'q' | CONTROL_C | CONTROL_D)) => Pressed::Quit,
        keys if keys.contains(&b'?') => Pressed::Help,
        _ => Pressed::Nothing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_their_commands_and_sequences_have_none() {
        for quit in [&b"q"[..], b"\x03", b"\x04", b"\x1b", b"xq"] {
            assert_eq!(parse_key(quit), Pressed::Quit, "{quit:?}");
        }
        for other in [&b"x"[..], b"\x1b[A", b"\x1bq", b"\r"] {
            assert_eq!(parse_key(other), Pressed::Nothing, "{other:?}");
        }
        assert_eq!(parse_key(b"?"), Pressed::Help);
    }
}
