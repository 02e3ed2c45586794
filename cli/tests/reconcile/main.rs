//! From a recording to a session of blocks: correct predictions and measurements, and clear messages about missing
//! data.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod a_long_recording;
mod accuracy;
mod bad_input;
#[path = "../common/mod.rs"]
mod common;
mod hidden_load;
mod make;
mod models;
mod spans;
mod subjects;
mod tare;
