//! Where model and measurement disagree: find it, name it, add it to the model, show the gap shrink.
//!
//! Data flow one way: a recording becomes a [`session::Session`] of [`block::Block`]s (what the model predicts and what
//! the plate measured, over a fraction of a second each, with everything that an effect's columns are made of); the
//! noise is fitted where nothing is suspected; every question about effects is then algebra on one whitened Gram matrix;
//! what is found is a [`finding::Finding`], from which model file and report are made.

pub mod block;
pub mod finding;
pub mod model_file;
pub mod session;
