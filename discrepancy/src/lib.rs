//! Where model and measurement disagree: find it, name it, add it to the model, show the gap shrink.
//!
//! Data flow one way: a recording becomes a [`session::Session`] of [`block::Block`]s (what the model predicts and what
//! the plate measured, over a fraction of a second each, with everything that an effect's columns are made of); the
//! noise is fitted where nothing is suspected; every question about effects is then algebra on one whitened Gram matrix;
//! what is found is a [`finding::Finding`], from which model file and report are made.

mod ask;
pub mod block;
mod candidate;
pub mod compare;
mod drawing;
mod edges;
mod evidence;
pub mod finding;
mod floor;
mod generic;
mod gram;
mod holdout;
mod linear;
mod locate;
pub mod model_file;
mod noise;
pub mod options;
pub mod picture;
pub mod reconcile;
mod refine;
pub mod report;
mod rows;
mod sanity;
mod select;
pub mod session;
pub mod spans;
mod telling;
pub mod thin;
mod trials;
mod verdict;
mod windows;

pub use options::{Options, ReconcileError};
pub use reconcile::{Fitted, Outcome, reconcile};
