//! What people see: the worker's page, the terminal, and the JSON that scripts read.
//!
//! [`state_json`] is the one place that turns a state into JSON, [`words`] the one place that turns it into plain
//! English. [`page`] and [`terminal`] only arrange what those two say. Nothing here runs in the loop.

pub mod incident_words;
pub mod metrics;
pub mod page;
pub mod state_json;
pub mod suggested_pose;
pub mod terminal;
pub mod words;

pub use page::{Page, PageError, PageFrame, Token, TokenError};
pub use state_json::StateJson;
pub use suggested_pose::SuggestedPose;
