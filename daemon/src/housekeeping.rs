//! What must be done now and then, and may take time: saving the worker, clearing away the dead, feeding the watchdog,
//! looking whether the model still explains what is measured.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event, Notifier, Subscriber};
use equipoise_core::cycle::Identification;
use equipoise_core::message::State;
use tracing::{info, warn};

use crate::model_watch::ModelWatch;
use crate::profile::Profile;
use crate::rings::Rings;
use crate::status::StatusFile;
use crate::workers::Workers;

const INTERVAL: Duration = Duration::from_secs(1);

/// A worker's number and what is known of that worker now.
pub type ChangedWorker = (u64, Box<Identification>);

/// Housekeeping, with its place on the bus.
pub struct Housekeeping {
    states: Subscriber<State>,
    events: Notifier,
    model: ModelWatch,
    rings: Arc<Rings>,
    worker_changed: Receiver<ChangedWorker>,
    workers: Arc<Workers>,
    status: StatusFile,
    last_cycle: u64,
    // Ports die before the node they hang on.
    bus: Bus,
}

impl Housekeeping {
    /// Joins the bus.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn open(
        station: &str,
        rings: Arc<Rings>,
        worker_changed: Receiver<ChangedWorker>,
        workers: Arc<Workers>,
        status: StatusFile,
    ) -> Result<Housekeeping, BusError> {
        let bus = Bus::join(&BusSettings::new(station, "housekeeping"))?;
        Ok(Housekeeping {
            states: bus.subscriber(1)?,
            events: bus.notifier(Channel::Results)?,
            model: ModelWatch::default(),
            rings,
            worker_changed,
            workers,
            status,
            last_cycle: 0,
            bus,
        })
    }

    /// Runs until egress, which sends the workers to save, has ended.
    pub fn run(mut self) {
        let mut last = Instant::now();
        loop {
            match self.worker_changed.recv_timeout(INTERVAL) {
                Ok(worker) => self.save(worker),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            if last.elapsed() >= INTERVAL {
                last = Instant::now();
                self.tidy();
            }
        }
    }

    fn save(&mut self, mut newest: ChangedWorker) {
        // Several poses may have come while the disk was slow; only the last of each worker counts.
        while let Ok(later) = self.worker_changed.try_recv() {
            if later.0 != newest.0 {
                self.write(&newest);
            }
            newest = later;
        }
        self.write(&newest);
    }

    fn write(&self, (number, worker): &ChangedWorker) {
        let Some(saving) = self.workers.get(*number).filter(|saving| saving.refusal.is_none()) else {
            return;
        };
        let Some(profile) = Profile::of(&saving.subject, saving.build, worker) else { return };
        if let Err(error) = profile.write(&saving.path) {
            warn!("{error}; the worker is kept in memory and saved again after the next pose");
        }
    }

    /// The model is never changed by it: a person decides what to make of it.
    fn watch_the_model(&mut self) {
        let Ok(Some(state)) = self.states.latest() else { return };
        if let Some(suspicion) = self.model.look(&state) {
            warn!("{suspicion}");
            // Nobody is woken on a broken bus, and its other users say so.
            let _ = self.events.notify(Event::ModelNoLongerExplains);
        }
        self.status.suspect(self.model.suspected().map(|suspicion| suspicion.to_string()));
    }

    fn tidy(&mut self) {
        let dead = self.bus.clean_up_dead_nodes();
        if dead > 0 {
            info!(dead, "cleared away what dead participants of the bus left behind");
        }
        // The watchdog is fed with completed cycles, not with this thread being alive.
        let cycle = self.rings.last_cycle();
        if cycle != self.last_cycle {
            self.last_cycle = cycle;
            let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
        }
        self.watch_the_model();
        if let Err(error) = self.status.write() {
            warn!("cannot write {}: {error}", self.status.path.display());
        }
    }
}
