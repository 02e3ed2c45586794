//! The RTDE outlet against a controller that is written from the protocol's text alone.
//!
//! `EQUIPOISE_RTDE_CONTROLLER=127.0.0.1:30004 cargo test -p equipoise-outlets --test rtde serves -- --nocapture` runs that
//! controller by itself: `.ci/rtde` lets a client that we did not write speak to it.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

mod controller;
mod documents;
#[path = "../udp/states.rs"]
mod states;
mod talk;
