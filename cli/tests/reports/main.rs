//! The report of a recording. Its numbers are compared with the JSON lines of a replay.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod page;
mod report;
mod session;
mod workers;
