//! Tests of the UDP gateway: its table in the documentation and in both readers, its bytes, and its sockets.
//!
//! `EQUIPOISE_WRITE=1 cargo test -p equipoise-gateways --test udp` writes the files that are generated from the table.
#![expect(clippy::unwrap_used, reason = "a test may panic")]

mod bytes;
mod generated;
mod readers;
mod sockets;
mod states;
