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
    /// As calibrated on clean sessions (docs/discrepancy.md).
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
        /// Blocks that there are.
        found: usize,
        /// Blocks required.
        needed: usize,
        /// How long each is, s.
        block_s: f64,
        /// Begin of the work, s.
        from_s: f64,
        /// Its end, s.
        to_s: f64,
    },
    /// There is hardly anything to compare the work with.
    #[error(
        "only {found} usable blocks lie outside the work in question, and {needed} are needed to know the noise; give \
         identification poses (--identify) or clean work (--reference)"
    )]
    NothingToCompareWith {
        /// Blocks that there are.
        found: usize,
        /// Blocks required.
        needed: usize,
    },
    /// A block holds something that is not a number.
    #[error("a value of the block at {time_s:.1} s is not a number; the recording is damaged there")]
    NotANumber {
        /// Middle of the block, s.
        time_s: f64,
    },
    /// Measured values repeat each other exactly, or the numbers do not allow a fit.
    #[error(
        "the noise of the {channel} cannot be fitted: do its values ever change? Check the sensor's wiring and channel"
    )]
    NoNoise {
        /// Which channel.
        channel: &'static str,
    },
}
