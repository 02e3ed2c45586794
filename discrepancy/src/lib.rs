//! Reconciliation of model and measurement: locates discrepancies, names their cause, adds it to the model and reports
//! how much the gap shrinks.
//!
//! Data flow one way: a recording becomes a [`session::Session`] of [`block::Block`]s (predictions of the model and
//! measurements of the plate over a fraction of a second each, with all inputs of the effects' columns); the noise is
//! fitted on the phases that are not in question; all inference about effects is algebra on one whitened Gram matrix;
//! the result is a [`finding::Finding`], from which model file and report are made. [`workflow`] makes the session of a
//! recording; [`session_report`] is the page about a recording without a comparison.

mod answer;
mod ask;
pub mod block;
mod candidate;
pub mod compare;
mod constants;
mod drawing;
mod evidence;
mod explanation;
pub mod finding;
mod floor;
mod generic;
mod gram;
mod holdout;
mod linear;
mod locate;
mod noise;
pub mod picture;
mod plausibility;
mod posterior;
pub mod reconcile;
mod refine;
pub mod report;
mod rows;
mod search;
mod select;
pub mod session;
pub mod session_report;
pub mod spans;
mod trials;
mod verdict;
mod windows;
pub mod workflow;

pub use reconcile::{Fitted, Options, Outcome, ReconcileError, reconcile};

// Sessions of the integration tests, for unit tests.
#[cfg(test)]
extern crate self as equipoise_discrepancy;
#[cfg(test)]
#[path = "../tests/support/mod.rs"]
mod support;
