//! Options and errors of a reconciliation.

use thiserror::Error;

/// Options of a reconciliation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Minimum log Bayes factor of a named effect; the level reached by chance on these data may be higher.
    pub least_log_odds: f64,
    /// Number of simulated clean sessions from which the level reached by chance is estimated.
    pub draws: usize,
}

impl Default for Options {
    /// Calibrated on clean sessions (docs/discrepancy.md).
    fn default() -> Options {
        Options { least_log_odds: 10.0, draws: 100 }
    }
}

/// Why a session cannot be reconciled.
#[derive(Debug, Error)]
pub enum ReconcileError {
    /// The work phase has too few blocks.
    #[error(
        "only {found} usable blocks of {block_s:.1} s lie in the work in question ({from_s:.1} s to {to_s:.1} s), and \
         {needed} are needed; choose a longer span with --work"
    )]
    TooLittleWork {
        /// Blocks found.
        found: usize,
        /// Blocks required.
        needed: usize,
        /// Length of a block, s.
        block_s: f64,
        /// Start of the work, s.
        from_s: f64,
        /// Its end, s.
        to_s: f64,
    },
    /// The recording has too few blocks outside the work.
    #[error(
        "only {found} usable blocks lie outside the work in question, and {needed} are needed to know the noise; give \
         identification poses (--identify) or clean work (--reference)"
    )]
    NothingToCompareWith {
        /// Blocks found.
        found: usize,
        /// Blocks required.
        needed: usize,
    },
    /// A block contains a value that is not finite.
    #[error("a value of the block at {time_s:.1} s is not a number; the recording is damaged there")]
    NotANumber {
        /// Middle of the block, s.
        time_s: f64,
    },
    /// Measured values are constant, or the numbers do not permit a fit.
    #[error(
        "the noise of the {channel} cannot be fitted: do its values ever change? Check the sensor's wiring and channel"
    )]
    NoNoise {
        /// The channel.
        channel: &'static str,
    },
}
