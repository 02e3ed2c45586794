//! Latency of each stage from sensor to state: stages, histograms, reports.
//!
//! The loop writes raw stamps into each `CycleRecord`; the readers of the records (egress, a latency consumer, a
//! replay) convert them into one histogram per [`Stage`]. Nothing here runs in the loop or reads a clock.
//!
//! Modules in the order of dependency: [`stage`] → [`histograms`] → [`receipt`] → [`report`], [`hlog`]
#![forbid(unsafe_code)]

pub mod histograms;
pub mod hlog;
pub mod receipt;
pub mod report;
pub mod stage;

pub use histograms::PathHistograms;
pub use hlog::{HlogError, HlogWriter};
pub use receipt::{ConsumerReceipts, ConsumerTimes};
pub use report::{ConsumerReport, Report, StageReport};
pub use stage::{NotRecorded, Stage};
