//! The report of a session: identification, exposure, lifts, dose, latency and data quality from a recording, as one
//! page.
//!
//! States come from the recording if it contains them, otherwise from a replay of its samples through the same cycle.
//! Invalid values are counted by reason and never drawn: lines break there.
//!
//! Layers, lowest first: [`series`], [`niosh`] → [`identification`], [`exposure`], [`lifts`], [`back`], [`quality`],
//! [`body_positions`], [`records`] → [`period`] → [`gather`] → `strips`, `stick_figure` → `recommendations`, `sections` →
//! `comparison` → [`document`](mod@document) → [`pdf`]

pub mod back;
pub mod body_positions;
mod comparison;
pub mod document;
pub mod exposure;
pub mod gather;
pub mod identification;
pub mod lifts;
pub mod niosh;
pub mod pdf;
pub mod period;
pub mod quality;
mod recommendations;
pub mod records;
mod sections;
pub mod series;
mod stick_figure;
mod strips;

pub use document::document;
pub use gather::{Facts, Source};
