//! What the calibration commands need in addition to the estimators of `equipoise_adapters::calibration`: samples from
//! the bus, latencies to configure, and edits of the configuration file that preserve its comments.

pub mod config_file;
pub mod latency;
pub mod load_check;
pub mod standing;
