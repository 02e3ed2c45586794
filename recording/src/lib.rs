//! Files in and out: [`record`] stores what a station publishes, [`replay`] computes it again, [`import`](mod@import)
//! converts captures of other programs, [`trace`] writes cycle records for a trace viewer.
#![forbid(unsafe_code)]

pub mod import;
pub mod record;
pub mod replay;
pub mod trace;
