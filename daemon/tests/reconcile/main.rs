//! From a recording to a session of blocks: right about what was predicted and measured, and clear about what it
//! lacks.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod accuracy;
mod bad_input;
#[path = "../common/mod.rs"]
mod common;
mod guidance;
mod live;
mod make;
mod memory;
mod models;
mod shows;
