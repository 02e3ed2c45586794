//! State of both sensor streams after the samples of a cycle were ingested.

use super::plausibility::Span;

/// State of both streams.
#[derive(Debug, Clone, Copy)]
pub(super) struct Streams {
    /// Estimated sample periods, ns.
    pub(super) suit_period_ns: u64,
    pub(super) ground_period_ns: u64,
    /// 1-σ of the lag in use between the streams, s.
    pub(super) lag_sigma_s: f64,
    /// Whether the data contradict that lag.
    pub(super) lag_is_off: bool,
    /// Interval in which the suit's samples are implausible, by the suit's stamps.
    pub(super) suit_suspect: Span,
    /// Interval in which the ground's samples are implausible, by the ground's stamps.
    pub(super) ground_suspect: Span,
    /// Longest interval before a ground sample of this cycle, ns.
    pub(super) ground_gap_ns: u64,
    /// Stamp of the first ground sample after the last gap, ns; 0 for none.
    pub(super) ground_resumed_ns: u64,
    /// Additional waiting time of a suit sample if the ground's stamps are late, ns.
    pub(super) ground_late_ns: u64,
    /// Time of the suit sample from which on the suit world is another one, ns; 0 for none.
    pub(super) moved_ns: u64,
}
