//! What people see: the worker's page, the terminal, and the JSON that scripts read.
//!
//! [`state_json`] is the one place that turns a state into JSON, [`words`] the one place that turns it into plain
//! English, [`foxglove`] the one that draws it for recordings and viewers. [`page`] and [`terminal`] only arrange what those two say. Nothing here runs in the loop.

pub mod banner;
pub mod foxglove;
pub mod incident_words;
pub mod metrics;
pub mod page;
#[cfg(test)]
mod schema_check;
pub mod state_json;
pub mod suggested_pose;
pub mod terminal;
pub mod watch;
pub mod words;

pub use page::{Page, PageError, PageFrame, Token};
pub use state_json::StateJson;
pub use suggested_pose::SuggestedPose;
