//! Views of a station: the worker's page, the terminal, and the JSON for scripts.
//!
//! [`state_json`] is the only module that converts a state to JSON, [`words`] the only one that converts it to plain
//! English, [`foxglove`] the only one that draws it for recordings and viewers. [`page`] and [`terminal`] arrange the
//! output of the first two. No code of this crate runs in the loop.

pub mod banner;
pub mod foxglove;
pub mod incident_words;
pub mod levels;
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

/// Whether a message is younger than `age_max_ns`, ns; false for a future time, which is of another time namespace.
pub fn is_current(time_ns: u64, now_ns: u64, age_max_ns: u64) -> bool {
    now_ns.checked_sub(time_ns).is_some_and(|age_ns| age_ns < age_max_ns)
}
