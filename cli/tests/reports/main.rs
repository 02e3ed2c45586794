//! Report and exports of a recording, compared with a replay.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod export;
mod page;
mod progress;
mod report;
mod session;
mod workers;
