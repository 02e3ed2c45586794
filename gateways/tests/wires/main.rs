//! The UDP and RTDE gateways, and the loop that drives a gateway: one test binary, so that waits overlap.
//!
//! `EQUIPOISE_WRITE=1 cargo test -p equipoise-gateways --test wires` writes the files generated from the tables.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

mod drive;
mod rtde;
mod states;
mod udp;
