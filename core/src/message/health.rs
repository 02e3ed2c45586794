//! How an adapter fares: what came in, and what was refused, by reason.

use super::layout::{ZeroCopySend, message};

/// How many reasons an adapter can count.
pub const REASONS: usize = 24;

message! {
    /// Counts of one adapter since its start, published once a second.
    as "equipoise/Health/2", 256 bytes,
    pub struct AdapterHealth {
        /// When it was published, CLOCK_MONOTONIC.
        pub time_ns: u64,
        /// Datagrams or records taken from the wire.
        pub received: u64,
        /// Samples published.
        pub published: u64,
        /// Samples the device sent and we never saw, by its counter and stride.
        pub lost: u64,
        /// Which stream: 1 suit, 2 ground.
        pub stream: u32,
        /// Process id of the adapter.
        pub process_id: u32,
        /// Samples a second over the last second.
        pub rate_hz: f64,
        /// What was refused, by reason; the adapter's documentation names the reasons in order.
        pub refused: [u64; REASONS],
        /// How long a device gathers samples before it sends them as one block, ns; 0 if it sends each by itself.
        pub block_latency_ns: u64,
        /// Always zero; fills the message to a multiple of 64 bytes.
        pub reserved_tail: u64,
    }
}
