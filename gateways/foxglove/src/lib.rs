//! Gateway to Foxglove and Lichtblick: publishes the scene and the state of a station live.
//!
//! Scene and state have the format of recordings ([`equipoise_view::foxglove`]). This crate adds a `beat` message at
//! every tick, with the age of the state or the reason why there is none, and the WebSocket server of the `foxglove`
//! crate. A viewer that reads too slowly loses the oldest messages of a queue of [`BACKLOG`]; publishing never waits
//! for a viewer.
#![forbid(unsafe_code)]

pub mod beat;
pub mod served;

pub use beat::Beat;
pub use served::{BACKLOG, FoxgloveGateway};
