//! The report of a session: what a recording tells of identification, exposure, lifts, dose, latency and data quality, as
//! one page for people.
//!
//! States come from the recording where it has them, else from a replay of its samples through the same cycle. What was
//! withheld is counted and named, and never drawn: a line breaks where there is nothing.
//!
//! Floors, ground first: [`series`] → [`identification`], [`exposure`], [`lifts`], [`back`], [`quality`], [`records`] → [`gather`] →
//! `strips`, `sections` → [`document`](mod@document) → [`pdf`]

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
