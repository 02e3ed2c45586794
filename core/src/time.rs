//! Time in the pipeline. `core` has no clock: every time is an input.

pub mod clock_fit;
pub mod skew;

pub use clock_fit::{ClockFit, Estimate};
pub use skew::{Skew, SkewEstimator};

/// Nanoseconds in a second.
pub const NS_PER_S: u64 = 1_000_000_000;

/// A span in seconds.
pub fn seconds(span_ns: u64) -> f64 {
    span_ns as f64 * 1e-9
}
