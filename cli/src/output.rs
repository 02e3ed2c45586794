//! Printing that does not end the command: the macros of std panic if the reader has closed the pipe, as `head` does, also
//! after work that cannot be undone.
//!
//! The macros have the names of those of std and replace them in all modules that follow in `lib.rs`.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::sync::OnceLock;

/// The first error of standard output; nothing is written after it.
static FAILURE: OnceLock<io::Error> = OnceLock::new();

/// Writes to standard output. After an error the output ends and the command continues.
pub(crate) fn write(text: Arguments<'_>) {
    record(|out| out.write_fmt(text));
}

fn record(write: impl FnOnce(&mut io::Stdout) -> io::Result<()>) {
    if FAILURE.get().is_some() {
        return;
    }
    if let Err(error) = write(&mut io::stdout()) {
        // Another thread may have set it.
        let _ = FAILURE.set(error);
    }
}

/// Completes the output; the error for which it is incomplete, unless the reader closed it.
pub(crate) fn finish() -> Option<&'static io::Error> {
    record(io::Stdout::flush);
    FAILURE.get().filter(|error| error.kind() != ErrorKind::BrokenPipe)
}

/// Writes to standard error, which may be a closed terminal.
pub(crate) fn write_error(text: Arguments<'_>) {
    let _ = io::stderr().write_fmt(text);
}

/// As std's `print!`, without its panic.
macro_rules! print {
    ($($argument:tt)*) => { $crate::output::write(format_args!($($argument)*)) };
}

/// As std's `println!`, without its panic.
macro_rules! println {
    ($($argument:tt)*) => { $crate::output::write(format_args!("{}\n", format_args!($($argument)*))) };
}

/// As std's `eprint!`, without its panic.
macro_rules! eprint {
    ($($argument:tt)*) => { $crate::output::write_error(format_args!($($argument)*)) };
}

/// As std's `eprintln!`, without its panic.
macro_rules! eprintln {
    ($($argument:tt)*) => { $crate::output::write_error(format_args!("{}\n", format_args!($($argument)*))) };
}
