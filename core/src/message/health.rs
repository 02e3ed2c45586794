//! Counts of an adapter: received, published, lost, and rejected by reason.

use super::layout::{ZeroCopySend, message};

/// Maximum number of rejection reasons of an adapter.
pub const REASONS: usize = 24;

message! {
    /// Counts of one adapter since its start, published once per second.
    as "equipoise/Health/2", 256 bytes,
    pub struct AdapterHealth {
        /// Time of publication, CLOCK_MONOTONIC ns.
        pub time_ns: u64,
        /// Datagrams or records received.
        pub received: u64,
        /// Samples published.
        pub published: u64,
        /// Samples sent by the device but not received, by its counter and stride.
        pub lost: u64,
        /// Stream: 1 suit, 2 ground.
        pub stream: u32,
        /// Process ID of the adapter.
        pub process_id: u32,
        /// Samples per second over the last second, Hz.
        pub rate_hz: f64,
        /// Rejected datagrams or samples by reason; the order of reasons is in the adapter's documentation.
        pub refused: [u64; REASONS],
        /// Time during which the device collects samples before it sends them as one block, ns; 0 if it sends each
        /// sample separately.
        pub block_latency_ns: u64,
        /// Always zero; pads the message to a multiple of 64 bytes.
        pub reserved_tail: u64,
    }
}
