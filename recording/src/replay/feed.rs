//! Returns the messages of a recording cycle by cycle.
//!
//! A recorder writes the pending messages stream by stream, so the messages of one cycle are close together but not in
//! order. All messages within two seconds are buffered and matched by number and time, never by position.

use std::collections::VecDeque;

use equipoise_adapters::recording::{Entries, Entry, Recording};
use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::{CycleRecord, EarlyState, GroundSample, State, SuitBody, SuitSample};
use equipoise_core::time::NS_PER_S;

use super::pending::Pending;

/// Read-ahead relative to the current cycle, ns.
const READ_AHEAD_NS: u64 = 2 * NS_PER_S;
/// Samples that no cycle ingested are dropped after this time, ns: the loop's rings hold far less.
const DISCARD_AFTER_NS: u64 = 10 * NS_PER_S;

/// The messages of one cycle.
pub(super) struct Cycle {
    pub(super) record: Box<CycleRecord>,
    /// The published state; `None` if it was lost.
    pub(super) state: Option<Box<State>>,
    /// The published early state, if the cycle has one in the recording.
    pub(super) early: Option<Box<EarlyState>>,
    /// Taken after this cycle's step.
    pub(super) checkpoint: Option<Box<Checkpoint>>,
}

/// Returns cycles in order.
pub(super) struct Feed<'a> {
    entries: Entries<'a>,
    cycles: VecDeque<Box<CycleRecord>>,
    states: VecDeque<Box<State>>,
    early: VecDeque<Box<EarlyState>>,
    /// Each with the time of the cycle after which it was taken.
    checkpoints: VecDeque<(u64, Box<Checkpoint>)>,
    pub(super) suit: Pending<SuitSample>,
    pub(super) ground: Pending<GroundSample>,
    bodies: VecDeque<Box<SuitBody>>,
    /// Newest time of a cycle that was read: stamps of samples may be of another clock.
    newest_ns: u64,
    ended: bool,
    /// Damage that ended reading before the end of the file.
    pub(super) damage: Option<String>,
}

impl<'a> Feed<'a> {
    pub(super) fn new(recording: &'a Recording) -> Feed<'a> {
        Feed {
            entries: recording.entries(),
            cycles: VecDeque::new(),
            states: VecDeque::new(),
            early: VecDeque::new(),
            checkpoints: VecDeque::new(),
            suit: Pending::default(),
            ground: Pending::default(),
            bodies: VecDeque::new(),
            newest_ns: 0,
            ended: false,
            damage: None,
        }
    }

    /// The next cycle of the file.
    pub(super) fn next_cycle(&mut self) -> Option<Cycle> {
        while !self.ended && !self.has_read_ahead() {
            self.read_one();
        }
        let record = self.cycles.pop_front()?;
        let due_ns = record.due_ns;
        while self.states.pop_front_if(|state| state.time_ns < due_ns).is_some() {}
        while self.early.pop_front_if(|early| early.time_ns < due_ns).is_some() {}
        while self.checkpoints.pop_front_if(|(time_ns, _)| *time_ns < due_ns).is_some() {}
        self.suit.discard_before(due_ns.saturating_sub(DISCARD_AFTER_NS));
        self.ground.discard_before(due_ns.saturating_sub(DISCARD_AFTER_NS));
        let discarded_ns = due_ns.saturating_sub(DISCARD_AFTER_NS);
        while self.bodies.pop_front_if(|body| body.published_ns < discarded_ns).is_some() {}
        let state = self.states.pop_front_if(|state| state.time_ns == due_ns);
        let early = self.early.pop_front_if(|early| early.time_ns == due_ns);
        let checkpoint = self.checkpoints.pop_front_if(|(time_ns, _)| *time_ns == due_ns);
        let checkpoint = checkpoint.map(|(_, checkpoint)| checkpoint);
        Some(Cycle { record, state, early, checkpoint })
    }

    /// The body dimensions that a cycle ingested, and whether the recording is complete in this respect; true if the
    /// cycle ingested none.
    pub(super) fn pop_body(&mut self, published_ns: u64) -> (Option<Box<SuitBody>>, bool) {
        if published_ns == 0 {
            return (None, true);
        }
        let at = self.bodies.iter().position(|body| body.published_ns == published_ns);
        let body = at.and_then(|at| self.bodies.remove(at));
        let found = body.is_some();
        (body, found)
    }

    fn has_read_ahead(&self) -> bool {
        self.cycles
            .front()
            .is_some_and(|record| self.newest_ns >= record.due_ns.saturating_add(READ_AHEAD_NS))
    }

    fn read_one(&mut self) {
        match self.entries.next() {
            None => self.ended = true,
            Some(Err(error)) => {
                self.damage = Some(error.to_string());
                self.ended = true;
            }
            Some(Ok(timed)) => match timed.entry {
                Entry::Cycle(record) => {
                    self.newest_ns = self.newest_ns.max(record.due_ns);
                    self.cycles.push_back(record);
                }
                Entry::State(state) => {
                    self.newest_ns = self.newest_ns.max(state.time_ns);
                    self.states.push_back(state);
                }
                Entry::Early(early) => self.early.push_back(early),
                Entry::Checkpoint(checkpoint) => {
                    // A checkpoint has no time stamp, but the state in its memory has one.
                    let time_ns = checkpoint.memory().map(|memory| memory.state.time_ns);
                    self.checkpoints.extend(time_ns.map(|time_ns| (time_ns, checkpoint)));
                }
                Entry::Suit(sample) => self.suit.push(sample),
                Entry::Ground(sample) => self.ground.push(sample),
                Entry::Body(body) => self.bodies.push_back(body),
                _ => {}
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;
    use equipoise_adapters::recording::{Recorder, RecordingHeader};

    use super::*;
    use crate::replay::pending::IngestedSamples;

    #[test]
    fn a_sample_stamped_in_the_future_does_not_end_the_read_ahead() {
        let mut recorder = Recorder::in_memory("a.mcap", &RecordingHeader::default()).unwrap();
        let sample =
            |sequence, published_ns| GroundSample { sequence, published_ns, ..GroundSample::zeroed() };
        let in_the_future = u64::MAX / 2;
        // As recorders of earlier releases write it, with its own stamp as log time.
        recorder.write(in_the_future, &sample(100, in_the_future)).unwrap();
        for cycle in 1..=3 {
            let due_ns = cycle * 1_000_000;
            recorder.write(due_ns, &CycleRecord { cycle, due_ns, ..CycleRecord::zeroed() }).unwrap();
        }
        for sequence in 1..=3 {
            recorder.write(sequence, &sample(sequence, sequence)).unwrap();
        }
        let recording = Recording::from_bytes(recorder.into_bytes().unwrap()).unwrap();
        let (mut feed, mut into) = (Feed::new(&recording), Vec::new());
        for number in 1..=3 {
            assert_eq!(feed.next_cycle().unwrap().record.cycle, number);
            let ingested = IngestedSamples { first: number, last: number, count: 1, last_sample_time_ns: 0 };
            assert!(feed.ground.pop(ingested, &mut into), "the sample of cycle {number}");
        }
    }
}
