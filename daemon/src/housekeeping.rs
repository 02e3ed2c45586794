//! Periodic tasks: removes dead nodes, publishes incidents and status, and checks whether the model still explains the
//! measurements. The bus's files and the status may be on a slow disk: saving and the watchdog have their own threads.

mod validity;

use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::{select, tick};
use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event, Notifier, Publisher, Subscriber};
use equipoise_config::Config;
use equipoise_core::message::{Incident, Incidents, State};
use tracing::warn;

use crate::incidents::IncidentBoard;
use crate::model_watch::ModelWatch;
use crate::realtime::now_ns;
use crate::rings::LoopControl;
use crate::status_file::StatusFile;
use crate::supervision::Supervision;
use crate::thread_registry::ThreadRegistry;
use crate::weighing::WeighingWatch;

use self::validity::ValidityIncidents;

/// Polling interval for incidents.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// All other tasks run once in this many polls: once a second.
const UPDATES_PER_CLEAN_UP: u32 = 20;

/// Housekeeping with its ports on the bus.
pub struct Housekeeping {
    states: Subscriber<State>,
    /// The newest state.
    newest: Option<State>,
    supervision: Supervision,
    incidents: Publisher<Incidents>,
    events: Notifier,
    model: ModelWatch,
    weighing: WeighingWatch,
    control: Arc<LoopControl>,
    board: Arc<IncidentBoard>,
    thread_registry: Arc<ThreadRegistry>,
    /// Value of the board's change counter at the last publication.
    published_changes: u64,
    /// Whether it was reported that some supervision is unavailable.
    error_reported: bool,
    status: StatusFile,
    /// Incidents by the flags of the newest state.
    validity: ValidityIncidents,
    // Ports must be dropped before the node that they depend on.
    bus: Bus,
}

impl Housekeeping {
    /// Joins the bus.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn open(
        config: &Config,
        control: Arc<LoopControl>,
        board: Arc<IncidentBoard>,
        thread_registry: Arc<ThreadRegistry>,
        status: StatusFile,
    ) -> Result<Housekeeping, BusError> {
        let bus = Bus::join(&BusSettings::new(&config.station, "housekeeping"))?;
        Ok(Housekeeping {
            states: bus.subscriber(1)?,
            newest: None,
            supervision: Supervision::open(&bus, config)?,
            incidents: bus.publisher()?,
            events: bus.notifier(Channel::Results)?,
            model: ModelWatch::default(),
            weighing: WeighingWatch::default(),
            control,
            board,
            thread_registry,
            published_changes: 0,
            error_reported: false,
            status,
            validity: ValidityIncidents::default(),
            bus,
        })
    }

    /// Runs until the loop has ended.
    pub fn run(mut self) {
        let (ticks, mut updates, mut ended) = (tick(POLL_INTERVAL), 0, false);
        while !ended {
            select! {
                recv(ticks) -> _ => {}
                // What happened since the last tick is published too.
                recv(self.control.ended()) -> _ => ended = true,
            }
            updates += 1;
            self.supervise();
            if updates % UPDATES_PER_CLEAN_UP == 0 {
                self.clean_up();
            }
            self.publish_incidents(updates % UPDATES_PER_CLEAN_UP == 0);
        }
        // Removes nodes that died since the last round.
        self.bus.clean_up_dead_nodes();
    }

    fn supervise(&mut self) {
        if let Ok(Some(state)) = self.states.latest() {
            self.newest = Some(state);
        }
        if let Some(state) = &self.newest {
            self.validity.update(state.validity(), now_ns(), &self.board);
        }
        let result = self.supervision.update(self.newest.as_ref(), self.control.refused(), &self.board);
        if let Err(error) = result
            && !std::mem::replace(&mut self.error_reported, true)
        {
            warn!("supervision does not see everything: {error}");
        }
    }

    /// On change at once, and once a second. A subscriber that joined receives the last message with the next poll.
    fn publish_incidents(&mut self, due: bool) {
        let changes = self.board.changes();
        let changed = changes != self.published_changes;
        let message = self.board.message();
        if changed {
            // The file first: a subscriber may read it as soon as the message arrives.
            self.status.set_incidents(self.board.messages());
            self.write_status();
        }
        // A failed bus is reported by its other users.
        if changed || due {
            self.published_changes = changes;
            let _ = self.incidents.send(&message);
        } else {
            let _ = self.incidents.update_connections();
        }
        if changed {
            let _ = self.events.notify(Event::IncidentsChanged);
        }
    }

    /// Reports only; a person decides whether to change the model, and what to do for the weighing.
    fn check_model(&mut self) {
        let Some(state) = &self.newest else { return };
        if self.model.check(state, &self.board, &self.status) {
            // A failed bus is reported by its other users.
            let _ = self.events.notify(Event::ModelMismatch);
        }
        self.status.set_weighing(self.weighing.update(state));
    }

    fn clean_up(&mut self) {
        self.supervision.check_adapters(&self.bus, &self.board, self.status.loop_faults());
        let dead = self.bus.clean_up_dead_nodes();
        if dead > 0 {
            self.board.report_once(
                Incident::ParticipantDied,
                &format!("{dead} participants of the bus had died; what they left behind is cleared away"),
            );
        }
        self.check_model();
        self.status.update_threads(&self.thread_registry, self.control.last_cycle());
        self.status.set_incidents(self.board.messages());
        self.write_status();
    }

    fn write_status(&self) {
        if let Err(error) = self.status.write() {
            warn!("cannot write {}: {error}", self.status.path.display());
        }
    }
}
