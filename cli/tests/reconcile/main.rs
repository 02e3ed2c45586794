//! From a recording to a session of blocks: correct predictions and measurements, and clear messages about missing
//! data.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod accuracy;
mod bad_input;
#[path = "../common/mod.rs"]
mod common;
mod hidden_load;
mod make;
mod memory;
mod models;
mod spans;
mod subjects;
mod tare;
