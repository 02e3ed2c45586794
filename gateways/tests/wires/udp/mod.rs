//! Tests of the UDP gateway: its table in the documentation and in both readers, its bytes, and its sockets.

mod bytes;
mod generated;
mod readers;
mod sockets;
