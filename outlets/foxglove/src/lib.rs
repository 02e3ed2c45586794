//! The scene and the state of a station, live, for Foxglove and Lichtblick.
//!
//! The picture is the recorder's ([`equipoise_view::foxglove`]); what is added here is a beat that says at every turn how
//! old the state is, or why there is none, and the WebSocket server of the `foxglove` crate. A viewer that reads too slowly
//! loses the oldest messages of a queue of [`BACKLOG`]; nobody waits for it.
#![forbid(unsafe_code)]

pub mod beat;
pub mod served;

pub use beat::Beat;
pub use served::{BACKLOG, FoxgloveOutlet};
