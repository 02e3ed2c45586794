//! What must be done now and then, and may take time: saving the worker, clearing away the dead, feeding the watchdog.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use equipoise_bus::{Bus, BusError, BusSettings};
use equipoise_core::cycle::Identification;
use tracing::{info, warn};

use crate::profile::Profile;
use crate::rings::Rings;
use crate::status::StatusFile;

const INTERVAL: Duration = Duration::from_secs(1);

/// Where the worker is saved.
#[derive(Debug, Clone)]
pub struct Saving {
    /// The pseudonym.
    pub subject: String,
    /// The file.
    pub path: PathBuf,
    /// `false` if the file is there and was refused: it is not overwritten.
    pub allowed: bool,
}

/// Housekeeping, with its place on the bus.
pub struct Housekeeping {
    bus: Bus,
    rings: Arc<Rings>,
    worker_changed: Receiver<Box<Identification>>,
    saving: Saving,
    status: StatusFile,
    last_cycle: u64,
}

impl Housekeeping {
    /// Joins the bus.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn open(
        station: &str,
        rings: Arc<Rings>,
        worker_changed: Receiver<Box<Identification>>,
        saving: Saving,
        status: StatusFile,
    ) -> Result<Housekeeping, BusError> {
        let bus = Bus::join(&BusSettings::new(station, "housekeeping"))?;
        Ok(Housekeeping { bus, rings, worker_changed, saving, status, last_cycle: 0 })
    }

    /// Runs until egress, which sends the workers to save, has ended.
    pub fn run(mut self) {
        let mut last = Instant::now();
        loop {
            match self.worker_changed.recv_timeout(INTERVAL) {
                Ok(worker) => self.save(&worker),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            if last.elapsed() >= INTERVAL {
                last = Instant::now();
                self.tidy();
            }
        }
    }

    fn save(&mut self, newest: &Identification) {
        // Several poses may have come while the disk was slow; only the last counts.
        let newest = self.worker_changed.try_iter().last().map_or(*newest, |later| *later);
        let Some(profile) = Profile::of(&self.saving.subject, &newest).filter(|_| self.saving.allowed) else {
            return;
        };
        if let Err(error) = profile.write(&self.saving.path) {
            warn!("{error}; the worker is kept in memory and saved again after the next pose");
        }
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
        if let Err(error) = self.status.write() {
            warn!("cannot write {}: {error}", self.status.path.display());
        }
    }
}
