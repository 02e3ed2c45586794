//! Opens all files that are read, such that none can block the reader or exceed the memory intended for it.
//!
//! [`open_regular`] rejects anything but regular files and does not wait for the writer of a pipe; [`read_text`] reads
//! up to a size limit; [`secret`] reads only files that other users can neither read nor change. [`Sha256`] names their
//! contents. [`atomic_file`] writes files; [`FileLock`] reserves a name for one process.
#![forbid(unsafe_code)]

pub mod atomic_file;
mod lock;
mod open;
pub mod secret;
mod sha256;
mod text;

pub use lock::FileLock;
pub use open::{Links, open_regular, open_regular_by};
pub use sha256::{Sha256, sha256_of, sha256_with};
pub use text::{TEXT_BYTES_MAX, read_text};
