//! Recordings of a station as MCAP files.
//!
//! [`record`] stores the messages of the bus. [`replay`] recomputes the states of a recording or capture with the cycle
//! of the live loop. [`import`](mod@import) converts captures of other programs to recordings. [`trace`] converts the
//! time stamps of the cycles to the Trace Event Format of Perfetto.
#![forbid(unsafe_code)]

pub mod import;
pub mod record;
pub mod replay;
pub mod trace;
