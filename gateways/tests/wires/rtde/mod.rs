//! The RTDE gateway against a controller that is implemented from the protocol's specification alone.
//!
//! `EQUIPOISE_RTDE_CONTROLLER=127.0.0.1:30004 cargo test -p equipoise-gateways --test wires serves -- --nocapture` runs
//! that controller by itself: `.ci/rtde` tests it with an independent client.

mod controller;
mod documents;
mod talk;
