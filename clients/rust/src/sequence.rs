//! Classifies states as new or old, counts missed ones, and detects restarts of the daemon.

use equipoise_core::message::State;

/// Relation of a state to earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Classification {
    /// Not later than an earlier state: left over from a dead daemon, or a duplicate.
    Old,
    /// Later than all earlier states.
    New {
        /// States between the previous one and this one, by `State::cycle`.
        missed: u64,
        /// The daemon has restarted.
        restarted: bool,
        /// Time of the newest suit sample, if this is the first state with it.
        suit_sample_time_ns: Option<u64>,
    },
}

#[derive(Debug, Clone, Copy)]
struct Last {
    cycle: u64,
    time_ns: u64,
    writer: u128,
}

/// The last state accepted.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sequence {
    last: Option<Last>,
    suit_sample_time_ns: u64,
}

impl Sequence {
    /// Classifies one state of a writer.
    ///
    /// States are ordered by time, because time continues across a restart of the daemon, while cycle numbers start
    /// again.
    pub(crate) fn classify(&mut self, state: &State, writer: u128) -> Classification {
        let (missed, restarted) = match self.last {
            None => (0, false),
            Some(last) if state.time_ns <= last.time_ns => return Classification::Old,
            Some(last) if writer != last.writer || state.cycle <= last.cycle => {
                (state.cycle.saturating_sub(1), true)
            }
            Some(last) => (state.cycle - last.cycle - 1, false),
        };
        self.last = Some(Last { cycle: state.cycle, time_ns: state.time_ns, writer });
        Classification::New { missed, restarted, suit_sample_time_ns: self.new_suit_sample(state) }
    }

    fn new_suit_sample(&mut self, state: &State) -> Option<u64> {
        // An age of 0 means a sample stamped after the cycle, whose time the state does not contain; u64::MAX means no
        // sample yet.
        let time_ns = state.time_ns.checked_sub(state.suit_age_ns).filter(|_| state.suit_age_ns > 0)?;
        if time_ns <= self.suit_sample_time_ns {
            return None;
        }
        self.suit_sample_time_ns = time_ns;
        Some(time_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn state(cycle: u64, time_ns: u64) -> State {
        State { cycle, time_ns, suit_age_ns: u64::MAX, ..State::zeroed() }
    }

    fn new(missed: u64, restarted: bool) -> Classification {
        Classification::New { missed, restarted, suit_sample_time_ns: None }
    }

    #[test]
    fn gaps_are_counted_and_what_is_not_later_is_old() {
        let mut sequence = Sequence::default();
        assert_eq!(sequence.classify(&state(7, 100), 1), new(0, false), "what was before is not missed");
        assert_eq!(sequence.classify(&state(8, 101), 1), new(0, false));
        assert_eq!(sequence.classify(&state(8, 101), 1), Classification::Old);
        assert_eq!(sequence.classify(&state(7, 100), 1), Classification::Old);
        assert_eq!(sequence.classify(&state(12, 105), 1), new(3, false));
    }

    #[test]
    fn a_restarted_daemon_counts_from_one_and_states_of_its_predecessor_are_old() {
        let mut sequence = Sequence::default();
        sequence.classify(&state(1000, 5000), 1);
        assert_eq!(sequence.classify(&state(3, 9000), 2), new(2, true));
        // The previous daemon's last states were in another buffer.
        assert_eq!(sequence.classify(&state(1001, 5001), 1), Classification::Old);
        assert_eq!(sequence.classify(&state(4, 9001), 2), new(0, false));
        // The next daemon had published states before the first one received.
        assert_eq!(sequence.classify(&state(2000, 20_000), 3), new(1999, true));
    }

    #[test]
    fn each_suit_sample_is_returned_once() {
        let mut sequence = Sequence::default();
        let mut suit_of = |time_ns, suit_age_ns| match sequence
            .classify(&State { suit_age_ns, ..state(time_ns, time_ns) }, 1)
        {
            Classification::New { suit_sample_time_ns, .. } => suit_sample_time_ns,
            Classification::Old => panic!("time goes on"),
        };
        assert_eq!(suit_of(100, u64::MAX), None, "no sample yet");
        assert_eq!(suit_of(101, 0), None, "a sample from ahead");
        assert_eq!(suit_of(102, 2), Some(100));
        assert_eq!(suit_of(103, 3), None);
        assert_eq!(suit_of(104, 1), Some(103));
    }
}
