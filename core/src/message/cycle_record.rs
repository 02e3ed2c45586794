//! What one cycle did and when: the latency proof, and all that a replay needs to do it again.

use super::layout::{ZeroCopySend, message};

message! {
    /// Stamps and inputs of one cycle. All stamps CLOCK_MONOTONIC; 0 where nothing has happened yet.
    ///
    /// With the samples it names, the record drives `core::cycle` again to the same state, byte for byte.
    as "equipoise/Cycle/3", 256 bytes,
    pub struct CycleRecord {
        /// The cycle's number, as in `State::cycle`.
        pub cycle: u64,
        /// Scheduled time of the cycle.
        pub due_ns: u64,
        /// When the loop's sleep returned.
        pub woken_ns: u64,
        /// When `core::cycle` was entered.
        pub compute_start_ns: u64,
        /// When it returned.
        pub compute_end_ns: u64,
        /// When egress began to publish the state: `State::published_ns`.
        pub publish_start_ns: u64,
        /// When egress had published the state.
        pub published_ns: u64,
        /// Newest suit sample in use: sample time.
        pub suit_sample_time_ns: u64,
        /// … kernel receive stamp.
        pub suit_arrival_ns: u64,
        /// … when the adapter published it.
        pub suit_published_ns: u64,
        /// … when ingress took it off the bus.
        pub suit_ingress_ns: u64,
        /// Newest ground sample in use: sample time.
        pub ground_sample_time_ns: u64,
        /// … kernel receive stamp.
        pub ground_arrival_ns: u64,
        /// … when the adapter published it.
        pub ground_published_ns: u64,
        /// … when ingress took it off the bus.
        pub ground_ingress_ns: u64,
        /// First suit sample taken in by this cycle (`SuitSample::sequence`); 0 if none was.
        pub suit_first: u64,
        /// Last suit sample taken in by this cycle; 0 if none was.
        pub suit_last: u64,
        /// First ground sample taken in by this cycle; 0 if none was.
        pub ground_first: u64,
        /// Last ground sample taken in by this cycle; 0 if none was.
        pub ground_last: u64,
        /// How many suit samples this cycle took in.
        pub suit_taken: u32,
        /// How many ground samples this cycle took in.
        pub ground_taken: u32,
        /// The command applied before this cycle's step: a `CommandKind`, 0 for none.
        pub command: u32,
        /// 1 if the state was ready only after the next cycle was due.
        pub deadline_missed: u32,
        /// The command's arguments.
        pub command_argument: [f64; 4],
        /// Periods dropped whole since start: `elapsed / period == cycles + slots_skipped`.
        pub slots_skipped: u64,
        /// Deadlines missed since start.
        pub deadlines_missed: u64,
        /// Samples dropped because a ring was full, since start.
        pub input_dropped: u64,
        /// Samples the loop refused since start: not plausible, or their time did not advance.
        pub input_refused: u64,
        /// States dropped because egress was too slow, since start.
        pub output_dropped: u64,
        /// Length of one period.
        pub period_ns: u64,
        /// The wearer's build taken in by this cycle: its `SuitBody::published_ns`; 0 if none was.
        pub body_published_ns: u64,
    }
}
