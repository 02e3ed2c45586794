//! Opens all files, such that none can block the process or exceed the memory intended for it.
//!
//! [`open_regular`] and [`write_regular`] reject anything but regular files and do not wait for the other end of a pipe;
//! [`read_text`] reads up to a size limit; [`secret`] reads only files that other users can neither read nor change. [`Sha256`] names their
//! contents. [`atomic_file`] writes files; [`FileLock`] reserves a name for one process.
#![forbid(unsafe_code)]

pub mod atomic_file;
mod lock;
mod open;
pub mod secret;
mod sha256;
mod text;

pub use lock::FileLock;
pub use open::{Existing, Links, open_regular, open_regular_by, write_regular};
pub use sha256::{Sha256, sha256_of, sha256_with};
pub use text::{TEXT_BYTES_MAX, read_text};
