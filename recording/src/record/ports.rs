//! Subscriptions of a recorder.
//!
//! A daemon numbers its cycles from 1, so a number that does not increase is the first of another daemon. A recorder
//! that begins a file for each daemon ends the file there and holds that message for the next file.

use anyhow::Context;
use equipoise_bus::{Bus, BusError, Subscriber, Topic};
use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::{
    AdapterHealth, CommandKind, CycleRecord, EarlyState, GroundSample, State, SuitBody, SuitSample,
};

use super::Sink;
use super::summary::RecordSummary;

/// The daemons whose messages one file contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Daemons {
    /// The daemon that runs at the start of the file.
    One,
    /// Later daemons, too.
    All,
}

/// All subscribers, with maximum buffer depths.
pub(super) struct Ports {
    cycle: CyclePort<CycleRecord>,
    state: CyclePort<State>,
    early: CyclePort<EarlyState>,
    checkpoint: CyclePort<Checkpoint>,
    suit: Subscriber<SuitSample>,
    ground: Subscriber<GroundSample>,
    body: Subscriber<SuitBody>,
    health: Subscriber<AdapterHealth>,
}

impl Ports {
    pub(super) fn open(bus: &Bus) -> Result<Ports, BusError> {
        Ok(Ports {
            cycle: CyclePort::open(bus)?,
            state: CyclePort::open(bus)?,
            early: CyclePort::open(bus)?,
            checkpoint: CyclePort::open(bus)?,
            suit: bus.subscriber(SuitSample::SERVICE.depth_max)?,
            ground: bus.subscriber(GroundSample::SERVICE.depth_max)?,
            body: bus.subscriber(SuitBody::SERVICE.depth_max)?,
            health: bus.subscriber(AdapterHealth::SERVICE.depth_max)?,
        })
    }

    /// Writes the held messages of the daemon whose start ended the previous file.
    pub(super) fn begin(&mut self, sink: &mut Sink, summary: &mut RecordSummary) -> anyhow::Result<()> {
        if self.is_next_daemon() {
            self.cycle.accept_next();
            self.state.accept_next();
            self.early.accept_next();
            self.checkpoint.accept_next();
        }
        let (cycle, state) = (self.cycle.held.take(), self.state.held.take());
        let (early, checkpoint) = (self.early.held.take(), self.checkpoint.held.take());
        cycle.map_or(Ok(()), |record| write_cycle(sink, summary, &record))?;
        state.map_or(Ok(()), |state| write_state(sink, summary, &state))?;
        early.map_or(Ok(()), |early| write_early(sink, summary, &early))?;
        checkpoint.map_or(Ok(()), |checkpoint| write_checkpoint(sink, summary, &checkpoint))
    }

    /// Whether a message of the next daemon waits for the next file.
    pub(super) fn is_next_daemon(&self) -> bool {
        self.cycle.held.is_some()
            || self.state.held.is_some()
            || self.early.held.is_some()
            || self.checkpoint.held.is_some()
    }

    /// Writes all pending messages. Each kind is fetched after the kinds published later than it, so that a recording
    /// that ends here contains the state and samples of every cycle record.
    pub(super) fn fetch(&mut self, sink: &mut Sink, summary: &mut RecordSummary) -> anyhow::Result<()> {
        let daemons = sink.daemons;
        self.cycle.fetch(daemons, |record| record.cycle, |record| write_cycle(sink, summary, record))?;
        self.state.fetch(daemons, |state| state.cycle, |state| write_state(sink, summary, state))?;
        self.early.fetch(daemons, |early| early.cycle, |early| write_early(sink, summary, early))?;
        self.checkpoint.fetch(
            daemons,
            |checkpoint| checkpoint.cycle,
            |checkpoint| write_checkpoint(sink, summary, checkpoint),
        )?;
        // Pending samples belong to the next daemon, and thus to the next file.
        if self.is_next_daemon() {
            return Ok(());
        }
        write_pending(&mut self.suit, |sample| {
            summary.suit.ingest(sample.sequence);
            sink.write_input(sample.published_ns, sample)
        })?;
        write_pending(&mut self.ground, |sample| {
            summary.ground.ingest(sample.sequence);
            sink.write_input(sample.published_ns, sample)
        })?;
        write_pending(&mut self.body, |body| sink.write_input(body.published_ns, body))?;
        write_pending(&mut self.health, |health| {
            summary.health += 1;
            sink.write_input(health.time_ns, health)
        })
    }
}

/// A subscription to messages with the number of a cycle.
struct CyclePort<M: Topic> {
    subscriber: Subscriber<M>,
    /// Number of the last message.
    last: Option<u64>,
    /// The first message of the next daemon.
    held: Option<Box<M>>,
}

impl<M: Topic> CyclePort<M> {
    fn open(bus: &Bus) -> Result<CyclePort<M>, BusError> {
        Ok(CyclePort { subscriber: bus.subscriber(M::SERVICE.depth_max)?, last: None, held: None })
    }

    /// Accepts lower cycle numbers, also if the first message of this kind from the next daemon is not received yet.
    fn accept_next(&mut self) {
        if self.held.is_none() {
            self.last = None;
        }
    }

    /// Writes the pending messages, with [`Daemons::One`] up to the first of the next daemon.
    fn fetch(
        &mut self,
        daemons: Daemons,
        number: impl Fn(&M) -> u64,
        mut write: impl FnMut(&M) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let CyclePort { subscriber, last, held } = self;
        for _ in 0..M::SERVICE.depth_max {
            if held.is_some() {
                break;
            }
            let received = subscriber.receive_with(|message| {
                let number = number(message);
                let is_restarted = last.replace(number).is_some_and(|last| number <= last);
                if is_restarted && daemons == Daemons::One {
                    *held = Some(boxed(message));
                    return Ok(());
                }
                write(message)
            })?;
            match received {
                Some(written) => written.with_context(|| "the recording has ended")?,
                None => break,
            }
        }
        Ok(())
    }
}

/// A copy on the heap: a checkpoint is too large for the stack.
fn boxed<M: Topic>(message: &M) -> Box<M> {
    let mut copy = bytemuck::zeroed_box::<M>();
    bytemuck::bytes_of_mut(&mut *copy).copy_from_slice(bytemuck::bytes_of(message));
    copy
}

fn write_cycle(sink: &mut Sink, summary: &mut RecordSummary, record: &CycleRecord) -> anyhow::Result<()> {
    summary.cycles.ingest(record.cycle);
    if record.command == CommandKind::Reload as u32 {
        sink.record_reload(record.due_ns, record.command_argument[0] as u64)?;
    }
    sink.write_result(record.due_ns, record)
}

fn write_state(sink: &mut Sink, summary: &mut RecordSummary, state: &State) -> anyhow::Result<()> {
    summary.states.ingest(state.cycle);
    sink.write_result(state.time_ns, state)?;
    sink.pictures.add(&mut sink.recorder, state)
}

fn write_early(sink: &mut Sink, summary: &mut RecordSummary, early: &EarlyState) -> anyhow::Result<()> {
    summary.early += 1;
    sink.write_result(early.time_ns, early)
}

fn write_checkpoint(
    sink: &mut Sink,
    summary: &mut RecordSummary,
    checkpoint: &Checkpoint,
) -> anyhow::Result<()> {
    summary.checkpoints += 1;
    // The record of the cycle that applied a reload may be lost.
    sink.record_reload(sink.newest_ns, checkpoint.settings_number)?;
    // A checkpoint has no time stamp.
    sink.write_result(sink.newest_ns, checkpoint)
}

/// Reads every pending message in place.
fn write_pending<M: Topic>(
    port: &mut Subscriber<M>,
    mut write: impl FnMut(&M) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    // At most one buffer's worth, so that a fast publisher cannot block this function.
    for _ in 0..M::SERVICE.depth_max {
        match port.receive_with(&mut write)? {
            Some(written) => written.with_context(|| "the recording has ended")?,
            None => break,
        }
    }
    Ok(())
}
