//! What is told of a recording afterwards: the report. Its numbers are held against the JSON lines of a replay.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod page;
mod report;
mod session;
mod workers;
