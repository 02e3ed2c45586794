//! The report of a session: identification, exposure, lifts, dose, latency and data quality from a recording, as one
//! page.
//!
//! States come from the recording if it contains them, otherwise from a replay of its samples through the same cycle.
//! Invalid values are counted by reason and never drawn: lines break there.
//!
//! Layers, lowest first: [`series`] → [`identification`], [`exposure`], [`lifts`], [`back`], [`quality`], [`records`] →
//! [`gather`] → `strips`, `sections` → [`document`](mod@document) → [`pdf`]

pub mod back;
pub mod document;
pub mod exposure;
pub mod gather;
pub mod identification;
pub mod lifts;
pub mod pdf;
pub mod quality;
pub mod records;
mod sections;
pub mod series;
mod strips;

pub use document::document;
pub use gather::{Facts, Source};
