//! Receipt of states by a consumer, which it reports so that the path is measured to its end.

use super::layout::{ZeroCopySend, message};

/// Sub-buckets per octave: times are resolved to 6 %.
pub const SUB_BUCKETS: u64 = 16;
/// Buckets of a histogram; the last contains all times from 2³⁴ ns (17 s) on.
pub const BUCKETS: usize = 512;

message! {
    /// Latency of the states received by one consumer: three histograms of ns since its start, published once per
    /// second.
    ///
    /// Reports are optional. Bucket of a time t: t itself below 16 ns; otherwise, with e = ⌊log₂ t⌋, `16 (e − 3) + (t
    /// >> (e − 4)) mod 16` ([`bucket`]). Counts are cumulative, so a reader that misses a report loses nothing.
    as "equipoise/ConsumerReceipt/1", 12416 bytes,
    pub struct ConsumerReceipt {
        /// Time of publication, CLOCK_MONOTONIC ns.
        pub time_ns: u64,
        /// Start of counting, CLOCK_MONOTONIC ns.
        pub since_ns: u64,
        /// Name of the consumer, UTF-8, padded with zeros: letters, digits, '-' and '_'.
        pub consumer: [u8; 32],
        /// Process ID of the consumer.
        pub process_id: u32,
        /// Always zero.
        pub reserved: u32,
        /// States received.
        pub states: u64,
        /// States not received, by the gaps in `State::cycle`.
        pub states_missed: u64,
        /// Maximum of each histogram, ns.
        pub max_ns: [u64; 3],
        /// Always zero; aligns the histograms to 64 bytes.
        pub reserved_head: [u64; 4],
        /// From `State::published_ns` to receipt: the bus, and the consumer's wake-up.
        pub published_to_consumer: [u64; BUCKETS],
        /// From `State::time_ns`, the cycle's due time, to receipt.
        pub due_to_consumer: [u64; BUCKETS],
        /// From the sample time of the newest suit sample to receipt; one value per new suit sample.
        pub suit_to_consumer: [u64; BUCKETS],
    }
}

/// Bucket of a time.
pub const fn bucket(time_ns: u64) -> usize {
    if time_ns < SUB_BUCKETS {
        return time_ns as usize;
    }
    let octave = 63 - time_ns.leading_zeros() as u64;
    let index = (SUB_BUCKETS * (octave - 3) + ((time_ns >> (octave - 4)) & (SUB_BUCKETS - 1))) as usize;
    if index < BUCKETS { index } else { BUCKETS - 1 }
}

/// Shortest time of a bucket, ns.
pub const fn shortest_ns(bucket: usize) -> u64 {
    let (bucket, sub_buckets) = (bucket as u64, SUB_BUCKETS);
    if bucket < sub_buckets {
        return bucket;
    }
    let octave = bucket / sub_buckets + 3;
    (sub_buckets + bucket % sub_buckets) << (octave - 4)
}

impl ConsumerReceipt {
    /// Counts one state received at `now_ns`, after `missed` states that were not received.
    ///
    /// `suit_sample_time_ns`: sample time of the newest suit sample, if this is the first state with it.
    pub fn enter(
        &mut self,
        now_ns: u64,
        state: &super::State,
        missed: u64,
        suit_sample_time_ns: Option<u64>,
    ) {
        self.states += 1;
        self.states_missed += missed;
        let froms = [Some(state.published_ns), Some(state.time_ns), suit_sample_time_ns];
        let histograms =
            [&mut self.published_to_consumer, &mut self.due_to_consumer, &mut self.suit_to_consumer];
        for ((from_ns, histogram), max_ns) in froms.into_iter().zip(histograms).zip(&mut self.max_ns) {
            // A stamp of 0 was not taken, and a stamp in the future belongs to another clock.
            if let Some(time_ns) = from_ns.filter(|from| *from > 0).and_then(|from| now_ns.checked_sub(from))
            {
                histogram[bucket(time_ns)] += 1;
                *max_ns = time_ns.max(*max_ns);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_time_lies_in_its_bucket_and_buckets_follow_each_other() {
        for index in 1..BUCKETS {
            let (from, before) = (shortest_ns(index), shortest_ns(index - 1));
            assert!(from > before);
            assert_eq!((bucket(from), bucket(from - 1)), (index, index - 1));
            // 16 sub-buckets per octave.
            assert!(from - before <= 1.max(before / 16));
        }
        assert_eq!(bucket(u64::MAX), BUCKETS - 1);
    }

    #[test]
    fn missing_and_future_stamps_are_not_counted() {
        let mut report: ConsumerReceipt = bytemuck::Zeroable::zeroed();
        let mut state: super::super::State = bytemuck::Zeroable::zeroed();
        (state.time_ns, state.published_ns) = (1_000, 0);
        report.enter(1_500, &state, 2, Some(2_000));
        assert_eq!((report.states, report.states_missed), (1, 2));
        assert_eq!(report.due_to_consumer[bucket(500)], 1);
        assert_eq!(report.published_to_consumer.iter().chain(&report.suit_to_consumer).sum::<u64>(), 0);
        assert_eq!(report.max_ns, [0, 500, 0]);
    }
}
