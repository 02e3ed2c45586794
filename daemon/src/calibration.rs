//! What the calibrating commands have beside the estimators of `equipoise_adapters::calibration`: moments out of the bus,
//! latencies to set, and a configuration file that is changed without losing a comment.

pub mod config_file;
pub mod latency;
pub mod load_check;
pub mod standing;
