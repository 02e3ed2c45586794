//! Recorded data, without a running daemon: imports, replays of real and simulated persons, malicious files.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod bombs;
#[path = "../common/mod.rs"]
mod common;
mod faulty_captures;
mod import_pairs;
mod impossible_numbers;
#[path = "../reconcile/make.rs"]
#[expect(dead_code, reason = "captures need a part of it")]
mod make;
mod replay_captures;
mod replay_latency;
mod replay_model;
mod replay_real_person;
mod replay_recomputed;
mod replay_recorded_cycles;
