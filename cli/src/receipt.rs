//! Receipts of the consumers in this crate: how late states arrive.

use equipoise_core::message::{ConsumerReceipt, State};

/// Data of the previous state, to detect gaps and new suit samples.
#[derive(Debug, Clone, Copy)]
struct Last {
    cycle: u64,
    suit_sample_time_ns: Option<u64>,
}

/// The receipt of one consumer, and the last state received.
#[derive(Debug)]
pub struct ReceiptBuilder {
    report: Box<ConsumerReceipt>,
    last: Option<Last>,
}

impl ReceiptBuilder {
    /// An empty receipt; `name` is truncated to the message's field.
    pub fn new(name: &str, now_ns: u64) -> ReceiptBuilder {
        let mut report: Box<ConsumerReceipt> = bytemuck::zeroed_box();
        let bytes = name.len().min(report.consumer.len());
        report.consumer[..bytes].copy_from_slice(&name.as_bytes()[..bytes]);
        (report.process_id, report.since_ns) = (std::process::id(), now_ns);
        ReceiptBuilder { report, last: None }
    }

    /// Adds a state received at `now_ns`.
    pub fn record(&mut self, state: &State, now_ns: u64) {
        // Ignore states published before the subscription: their waiting time is not a latency.
        if state.published_ns < self.report.since_ns {
            return;
        }
        // An age of zero may mean a sample later than the cycle's due time; the next state provides its time.
        let sample_ns = state.time_ns.checked_sub(state.suit_age_ns).filter(|_| state.suit_age_ns > 0);
        let now = Last { cycle: state.cycle, suit_sample_time_ns: sample_ns };
        let last = self.last.replace(now);
        let missed = last.map_or(0, |last| state.cycle.saturating_sub(last.cycle + 1));
        let is_new = last.is_some_and(|last| last.suit_sample_time_ns != sample_ns);
        self.report.enter(now_ns, state, missed, sample_ns.filter(|_| is_new));
    }

    /// As [`Self::record`], for a state that may be read repeatedly: each one is added once.
    pub fn record_once(&mut self, state: &State, now_ns: u64) {
        if self.last.is_none_or(|last| last.cycle != state.cycle) {
            self.record(state, now_ns);
        }
    }

    /// The receipt so far.
    pub fn report(&self) -> &ConsumerReceipt {
        &self.report
    }

    /// The receipt with its time stamp, for publication.
    pub fn stamped(&mut self, now_ns: u64) -> &ConsumerReceipt {
        self.report.time_ns = now_ns;
        &self.report
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    fn state(cycle: u64) -> State {
        let time_ns = 1_000_000 * cycle;
        State { cycle, time_ns, published_ns: time_ns + 100, suit_age_ns: u64::MAX, ..State::zeroed() }
    }

    #[test]
    fn a_state_counts_once_and_gaps_count_as_missed() {
        let mut receipt = ReceiptBuilder::new("view", 5_000_000);
        receipt.record_once(&state(4), 5_000_001);
        assert_eq!(receipt.report().states, 0, "it was there before we were");
        for cycle in [6, 6, 9, 9, 9] {
            receipt.record_once(&state(cycle), 20_000_000);
        }
        let report = receipt.stamped(21_000_000);
        assert_eq!((report.states, report.states_missed, report.time_ns), (2, 2, 21_000_000));
        assert_eq!(&report.consumer[..5], b"view\0");
        assert_eq!(report.max_ns[1], 14_000_000, "from when the cycle was due");
    }
}
