//! Where time goes along the path: stages, histograms, reports.
//!
//! The loop writes raw stamps into each `CycleRecord`; whoever reads the records (egress, a latency consumer, a
//! replay) turns them into one histogram per [`Stage`]. Nothing here runs in the loop, and nothing here reads a
//! clock.
//!
//! Floors, ground first: [`stage`] → [`histograms`] → [`pick_up`] → [`report`], [`hlog`]
#![forbid(unsafe_code)]

pub mod histograms;
pub mod hlog;
pub mod pick_up;
pub mod report;
pub mod stage;

pub use histograms::PathHistograms;
pub use hlog::{HlogError, HlogWriter};
pub use pick_up::{ConsumerTimes, PickUps};
pub use report::{ConsumerReport, Report, StageReport};
pub use stage::{NotRecorded, Stage};
