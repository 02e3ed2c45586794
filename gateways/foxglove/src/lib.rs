//! Gateway to Foxglove and Lichtblick: publishes the scene and the state of a station live.
//!
//! Scene and state have the format of recordings ([`equipoise_view::foxglove`]). This crate adds a `heartbeat` message at
//! every tick, with the age of the state or the reason why there is none, and the WebSocket server of the `foxglove`
//! crate. A viewer that reads too slowly loses the oldest messages of a queue of [`BACKLOG`]; publishing never waits
//! for a viewer.
#![forbid(unsafe_code)]

pub mod heartbeat;
pub mod served;

pub use heartbeat::Heartbeat;
pub use served::{BACKLOG, FoxgloveGateway};
