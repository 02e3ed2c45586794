//! Data for Foxglove and Lichtblick without a plugin: the scene and the state of a station, in the same form for
//! recordings and for the live gateway.
//!
//! Messages are JSON with a JSON schema. The well-known schema `foxglove.SceneUpdate` permits this encoding,
//! [`StateJson`] is JSON anyway, and neither recorder nor gateway needs an extra library. Lengths are rounded to 0.1 mm
//! to keep the text short; `docs/recordings.md` gives the file size.
//!
//! Invalid values are not drawn, and entities expire after [`scene::LIFETIME_NS`], so that a silent station disappears.
//!
//! Modules, lowest layer first: `primitives` → `schema`, `figure` → [`scene`] → [`Channel`]

mod figure;
mod primitives;
pub mod scene;
mod schema;
#[cfg(test)]
mod tests;

use equipoise_core::message::State;

pub use primitives::SceneUpdate;

use crate::state_json::StateJson;

/// Encoding of messages, by its name in MCAP and in the WebSocket protocol.
pub const MESSAGE_ENCODING: &str = "json";
/// Encoding of schemas.
pub const SCHEMA_ENCODING: &str = "jsonschema";

/// A channel that viewers can display.
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    /// Its topic.
    pub topic: &'static str,
    /// Schema name, by which viewers recognise `foxglove.SceneUpdate`.
    pub schema_name: &'static str,
    schema: fn() -> serde_json::Value,
}

impl Channel {
    /// The figure, the centres of pressure and the support polygon.
    pub const SCENE: Channel = Channel {
        topic: "/equipoise/scene",
        schema_name: "foxglove.SceneUpdate",
        schema: schema::scene_update,
    };
    /// The state, as [`StateJson`].
    pub const STATE: Channel = Channel {
        topic: "/equipoise/state_json",
        schema_name: "equipoise.State",
        schema: crate::state_json::schema::state,
    };
    /// Both channels.
    pub const ALL: [Channel; 2] = [Channel::SCENE, Channel::STATE];

    /// The schema as text.
    pub fn schema_text(&self) -> String {
        (self.schema)().to_string()
    }
}

/// Encodes a state as the message of [`Channel::STATE`]; its `t` is on CLOCK_MONOTONIC.
///
/// # Errors
/// Never; the signature is serde's.
pub fn state_text(state: &State) -> serde_json::Result<String> {
    StateJson::new(state, equipoise_core::time::seconds(state.time_ns)).to_text()
}
