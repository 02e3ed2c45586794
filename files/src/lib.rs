//! Every file that is read is opened here, so that none can make the reader wait, or hold more than it has room for.
//!
//! [`open_regular`] refuses what is no regular file, without waiting for a pipe's writer; [`read_text`] reads up to a
//! bound; [`secret`] reads only what nobody else can read or change.
#![forbid(unsafe_code)]

mod open;
pub mod secret;
mod text;

pub use open::{Links, open_regular, open_regular_by};
pub use text::{TEXT_BYTES_MAX, read_text};
