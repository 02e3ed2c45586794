//! The RTDE gateway against a controller that is implemented from the protocol's specification alone.
//!
//! `EQUIPOISE_RTDE_CONTROLLER=127.0.0.1:30004 cargo test -p equipoise-gateways --test rtde serves -- --nocapture` runs
//! that controller by itself: `.ci/rtde` tests it with an independent client.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

mod controller;
mod documents;
#[path = "../udp/states.rs"]
mod states;
mod talk;
