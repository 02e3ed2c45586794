//! From the loop to the bus: publishes, stamps, wakes consumers, hands every outcome to the latency log.

use std::sync::Arc;
use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event, Kept, Notifier, Publisher};
use equipoise_core::cycle::Checkpoint;
use equipoise_core::message::{CycleRecord, PickUp, State};
use tracing::debug;

use crate::latency_log::feed::Feed;
use crate::realtime::now_ns;
use crate::rings::{Outcome, Rings, Waiting};

const WAKE_AT_LEAST: Duration = Duration::from_millis(50);

/// Egress, with its ports open.
pub struct Egress {
    rings: Arc<Rings>,
    waiting: Waiting,
    state: Publisher<State>,
    cycle: Publisher<CycleRecord>,
    checkpoint: Publisher<Checkpoint>,
    events: Notifier,
    phase: u32,
    deadlines_missed: u64,
    latency_log: Feed,
    /// Written and read by others, who come and are killed as they like.
    _pick_up: Kept<PickUp>,
    last_checkpoint_service: Instant,
    // Ports die before the node they hang on.
    _bus: Bus,
}

impl Egress {
    /// Opens the ports.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn open(
        station: &str,
        rings: Arc<Rings>,
        waiting: Waiting,
        latency_log: Feed,
    ) -> Result<Egress, BusError> {
        let bus = Bus::join(&BusSettings::new(station, "egress"))?;
        Ok(Egress {
            rings,
            waiting,
            state: bus.publisher()?,
            cycle: bus.publisher()?,
            checkpoint: bus.publisher()?,
            events: bus.notifier(Channel::Results)?,
            phase: u32::MAX,
            deadlines_missed: 0,
            latency_log,
            _pick_up: bus.keep()?,
            last_checkpoint_service: Instant::now(),
            _bus: bus,
        })
    }

    /// Publishes until the loop has ended and its last word is out.
    ///
    /// # Errors
    /// The bus breaks.
    pub fn run(mut self) -> Result<(), BusError> {
        loop {
            // Asked before the rings are emptied: what the loop said last is in them then.
            let ended = self.rings.has_ended();
            self.rings.await_outcome(self.waiting, WAKE_AT_LEAST);
            self.publish_outcomes()?;
            while let Some(checkpoint) = self.rings.taken.pop() {
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

    /// Publishes what the loop has said so far; how many cycles.
    ///
    /// # Errors
    /// The bus breaks.
    pub fn publish_outcomes(&mut self) -> Result<usize, BusError> {
        let mut published = 0;
        while let Some(outcome) = self.rings.outcome.pop() {
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
        // One awakening per cycle; what else happened is said with it, and before the record, which nobody waits for.
        if state.phase != self.phase {
            self.phase = state.phase;
            // Not of the journal: a sensor with short gaps changes it several times a second. Incidents are.
            debug!(phase = state.phase_name(), cycle = state.cycle, "phase");
            self.events.notify(Event::PhaseChanged)?;
        }
        if record.deadlines_missed != self.deadlines_missed {
            self.deadlines_missed = record.deadlines_missed;
            self.events.notify(Event::DeadlineMissed)?;
        }
        self.events.notify(Event::NewState)?;
        self.cycle.send(&record)?;
        self.latency_log.hand_over(Outcome { state, record });
        Ok(())
    }

    fn publish_checkpoint(&mut self, checkpoint: Box<Checkpoint>) -> Result<(), BusError> {
        self.checkpoint.send(&checkpoint)?;
        self.events.notify(Event::NewCheckpoint)?;
        // There are as many places as boxes.
        let _ = self.rings.blank.push(checkpoint);
        Ok(())
    }
}
