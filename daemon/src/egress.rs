//! Publishes the loop's outcomes on the bus, stamps them, wakes consumers, and passes every outcome to the latency log.

use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event, Notifier, Publisher, RetainedService};
use equipoise_config::WaitStrategy;
use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::{ConsumerReceipt, CycleRecord, EarlyState, State};
use tracing::debug;

use crate::latency_log::feed::Feed;
use crate::realtime::now_ns;
use crate::rings::{EgressEnds, Outcome};

const WAKE_INTERVAL: Duration = Duration::from_millis(50);

/// Egress with its open ports.
pub struct Egress {
    ends: EgressEnds,
    wait_strategy: WaitStrategy,
    state: Publisher<State>,
    early: Publisher<EarlyState>,
    cycle: Publisher<CycleRecord>,
    checkpoint: Publisher<Checkpoint>,
    events: Notifier,
    phase: u32,
    deadlines_missed: u64,
    latency_log: Feed,
    /// Kept open because the processes that write and read it may start and be killed at any time.
    _receipt: RetainedService<ConsumerReceipt>,
    last_checkpoint_service: Instant,
    // Ports must be dropped before the node that they depend on.
    _bus: Bus,
}

impl Egress {
    /// Opens the ports.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn open(
        station: &str,
        ends: EgressEnds,
        wait_strategy: WaitStrategy,
        latency_log: Feed,
    ) -> Result<Egress, BusError> {
        let bus = Bus::join(&BusSettings::new(station, "egress"))?;
        Ok(Egress {
            ends,
            wait_strategy,
            state: bus.publisher()?,
            early: bus.publisher()?,
            cycle: bus.publisher()?,
            checkpoint: bus.publisher()?,
            events: bus.notifier(Channel::Results)?,
            phase: u32::MAX,
            deadlines_missed: 0,
            latency_log,
            _receipt: bus.retain()?,
            last_checkpoint_service: Instant::now(),
            _bus: bus,
        })
    }

    /// Publishes until the loop has ended and its last outcome is published.
    ///
    /// # Errors
    /// The bus fails.
    pub fn run(mut self) -> Result<(), BusError> {
        loop {
            // Checked before the rings are emptied, so that they contain the loop's last outcome.
            let ended = self.ends.control.has_ended();
            self.wait();
            self.publish_outcomes()?;
            while let Ok(checkpoint) = self.ends.checkpoints.pop() {
                self.publish_checkpoint(checkpoint)?;
            }
            if self.last_checkpoint_service.elapsed() > Duration::from_secs(1) {
                self.checkpoint.update_connections()?;
                self.last_checkpoint_service = Instant::now();
            }
            if ended {
                return Ok(());
            }
        }
    }

    /// Waits for an outcome or until a short time passes.
    pub fn wait(&self) {
        self.ends.await_outcome(self.wait_strategy, WAKE_INTERVAL);
    }

    /// Publishes the loop's outcomes so far; returns the number of cycles.
    ///
    /// # Errors
    /// The bus fails.
    pub fn publish_outcomes(&mut self) -> Result<usize, BusError> {
        let mut published = 0;
        while let Ok(outcome) = self.ends.outcome.pop() {
            self.publish(outcome)?;
            published += 1;
        }
        Ok(published)
    }

    fn publish(&mut self, Outcome { mut state, mut record }: Outcome) -> Result<(), BusError> {
        state.published_ns = now_ns();
        record.publish_start_ns = state.published_ns;
        self.state.send(&state)?;
        record.published_ns = now_ns();
        // The loop passes it before the outcome of its cycle, so subscribers woken by `NewState` receive both.
        while let Ok(mut early) = self.ends.early.pop() {
            early.published_ns = now_ns();
            self.early.send(&early)?;
        }
        // One `NewState` per cycle, after other events and before the cycle record, for which no consumer waits.
        if state.phase != self.phase {
            self.phase = state.phase;
            // Not in the journal: a sensor with short gaps changes the phase several times a second. Incidents are
            // logged.
            debug!(phase = state.phase_name(), cycle = state.cycle, "phase");
            self.events.notify(Event::PhaseChanged)?;
        }
        if record.deadlines_missed != self.deadlines_missed {
            self.deadlines_missed = record.deadlines_missed;
            self.events.notify(Event::DeadlineMissed)?;
        }
        self.events.notify(Event::NewState)?;
        self.cycle.send(&record)?;
        self.latency_log.push(Outcome { state, record });
        Ok(())
    }

    fn publish_checkpoint(&mut self, checkpoint: Box<Checkpoint>) -> Result<(), BusError> {
        self.checkpoint.send(&checkpoint)?;
        self.events.notify(Event::NewCheckpoint)?;
        // Cannot fail: the ring has as many slots as there are boxes.
        let _ = self.ends.free_checkpoints.push(checkpoint);
        Ok(())
    }
}
