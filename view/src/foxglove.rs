//! What Foxglove and Lichtblick show without a plugin: the scene and the state of a station, the same in a recording and
//! live.
//!
//! Messages are JSON with a JSON schema. The well-known schema `foxglove.SceneUpdate` may be encoded so, [`StateJson`] is
//! JSON anyway, and neither recorder nor outlet needs a library for it. Lengths are rounded to 0.1 mm, which keeps the text
//! short; what it costs in a file is in `docs/recordings.md`.
//!
//! What is withheld is not drawn, and a picture lives for [`scene::LIFETIME_NS`]: a station that fell silent fades.
//!
//! Floors, ground first: `primitives` → `schema`, `figure` → [`scene`] → [`Channel`]

mod figure;
mod primitives;
pub mod scene;
mod schema;
#[cfg(test)]
mod tests;

use equipoise_core::message::State;

pub use primitives::SceneUpdate;

use crate::state_json::StateJson;

/// How messages are encoded, as MCAP and the WebSocket protocol call it.
pub const MESSAGE_ENCODING: &str = "json";
/// How schemas are encoded.
pub const SCHEMA_ENCODING: &str = "jsonschema";

/// A kind of message that viewers show.
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    /// Its topic.
    pub topic: &'static str,
    /// The name of its schema: viewers know `foxglove.SceneUpdate` by it.
    pub schema_name: &'static str,
    schema: fn() -> serde_json::Value,
}

impl Channel {
    /// The figure, the centres of pressure and the ground below them.
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
    /// Both.
    pub const ALL: [Channel; 2] = [Channel::SCENE, Channel::STATE];

    /// The schema as text.
    pub fn schema_text(&self) -> String {
        (self.schema)().to_string()
    }
}

/// A state as the message of [`Channel::STATE`], its `t` on CLOCK_MONOTONIC.
///
/// # Errors
/// None that can happen: serde's signature.
pub fn state_text(state: &State) -> serde_json::Result<String> {
    StateJson::new(state, equipoise_core::time::seconds(state.time_ns)).to_text()
}
