//! Record of one cycle: stamps for the latency of each stage, and the inputs that a replay needs.

use super::layout::{ZeroCopySend, message};

message! {
    /// Stamps and inputs of one cycle. All stamps are CLOCK_MONOTONIC ns; 0 if the event did not occur.
    ///
    /// Together with the samples that it names, the record reproduces the state byte for byte in a replay.
    as "equipoise/Cycle/3", 256 bytes,
    pub struct CycleRecord {
        /// Number of the cycle: `State::cycle`.
        pub cycle: u64,
        /// Due time of the cycle.
        pub due_ns: u64,
        /// Return of the loop's sleep.
        pub woken_ns: u64,
        /// Start of `core::cycle::step`.
        pub compute_start_ns: u64,
        /// End of `core::cycle::step`.
        pub compute_end_ns: u64,
        /// Start of publishing by egress: `State::published_ns`.
        pub publish_start_ns: u64,
        /// End of publishing by egress.
        pub published_ns: u64,
        /// Newest suit sample in use: sample time.
        pub suit_sample_time_ns: u64,
        /// … kernel's receive stamp.
        pub suit_arrival_ns: u64,
        /// … published by the adapter.
        pub suit_published_ns: u64,
        /// … received by ingress.
        pub suit_ingress_ns: u64,
        /// Newest ground sample in use: sample time.
        pub ground_sample_time_ns: u64,
        /// … kernel's receive stamp.
        pub ground_arrival_ns: u64,
        /// … published by the adapter.
        pub ground_published_ns: u64,
        /// … received by ingress.
        pub ground_ingress_ns: u64,
        /// First suit sample ingested by this cycle (`SuitSample::sequence`); 0 if none.
        pub suit_first: u64,
        /// Last suit sample ingested by this cycle; 0 if none.
        pub suit_last: u64,
        /// First ground sample ingested by this cycle; 0 if none.
        pub ground_first: u64,
        /// Last ground sample ingested by this cycle; 0 if none.
        pub ground_last: u64,
        /// Number of suit samples ingested by this cycle.
        pub suit_taken: u32,
        /// Number of ground samples ingested by this cycle.
        pub ground_taken: u32,
        /// Command applied before this cycle's step: a `CommandKind`; 0 for none.
        pub command: u32,
        /// 1 if the state was complete only after the next cycle's due time.
        pub deadline_missed: u32,
        /// Arguments of the command.
        pub command_argument: [f64; 4],
        /// Slots skipped since the start: `elapsed / period == cycles + slots_skipped`.
        pub slots_skipped: u64,
        /// Deadlines missed since the start.
        pub deadlines_missed: u64,
        /// Samples dropped by full rings since the start.
        pub input_dropped: u64,
        /// Samples rejected by the loop since the start: implausible, or without an advancing time.
        pub input_refused: u64,
        /// States dropped since the start, because egress was too slow.
        pub output_dropped: u64,
        /// Length of one period, ns.
        pub period_ns: u64,
        /// Body dimensions ingested by this cycle: `SuitBody::published_ns`; 0 if none.
        pub body_published_ns: u64,
    }
}
