//! The real binary with a simulated person or a recorded one: what it records, replays and imports. The tests wait for
//! sensors most of the time, so they share one process and run in parallel.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

#[path = "../common/mod.rs"]
mod common;
mod insoles;
mod null_pose;
mod record_live;
mod record_pictures;
mod record_service;
mod record_signed;
mod replay_model;
mod replay_real_person;
