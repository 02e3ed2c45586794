//! What must be done now and then: clearing away the dead, feeding the watchdog, telling incidents and status, looking
//! whether the model still explains what is measured. Nothing here waits for a disk: saving has a thread of its own.

use std::sync::Arc;
use std::time::Duration;

use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event, Notifier, Publisher, Subscriber};
use equipoise_core::message::{Incident, Incidents, State, Validity};
use tracing::warn;

use crate::config::Config;
use crate::incidents::IncidentBoard;
use crate::model_watch::ModelWatch;
use crate::rings::Rings;
use crate::roster::Roster;
use crate::status::StatusFile;
use crate::supervision::Supervision;

/// How often incidents are looked at.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// All else is done once in so many looks: once a second.
const LOOKS_PER_TIDYING: u32 = 20;

/// Housekeeping, with its place on the bus.
pub struct Housekeeping {
    states: Subscriber<State>,
    /// The newest state so far.
    newest: Option<State>,
    supervision: Supervision,
    incidents: Publisher<Incidents>,
    events: Notifier,
    model: ModelWatch,
    rings: Arc<Rings>,
    board: Arc<IncidentBoard>,
    roster: Arc<Roster>,
    /// How many changes of the board were published.
    told_changes: u64,
    /// Whether it was told that something cannot be seen.
    blind_told: bool,
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
        config: &Config,
        rings: Arc<Rings>,
        board: Arc<IncidentBoard>,
        roster: Arc<Roster>,
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
            rings,
            board,
            roster,
            told_changes: 0,
            blind_told: false,
            status,
            last_cycle: 0,
            bus,
        })
    }

    /// Runs until the loop has ended.
    pub fn run(mut self) {
        let mut looks = 0;
        while !self.rings.has_ended() {
            std::thread::sleep(LOOK_EVERY);
            looks += 1;
            self.supervise();
            if looks % LOOKS_PER_TIDYING == 0 {
                self.tidy();
            }
            self.tell_incidents(looks % LOOKS_PER_TIDYING == 0);
        }
        // Whoever died since the last round.
        self.bus.clean_up_dead_nodes();
    }

    fn supervise(&mut self) {
        if let Ok(Some(state)) = self.states.latest() {
            self.newest = Some(state);
        }
        self.watch_the_place();
        let looked = self.supervision.look(self.newest.as_ref(), self.rings.refused(), &self.board);
        if let Err(error) = looked
            && !std::mem::replace(&mut self.blind_told, true)
        {
            warn!("supervision does not see everything: {error}");
        }
    }

    /// On change at once, and once a second for whoever comes late.
    fn tell_incidents(&mut self, due: bool) {
        let changes = self.board.changes();
        let changed = changes != self.told_changes;
        if changed || due {
            self.told_changes = changes;
            // On a broken bus nobody is told, and its other users say so.
            let _ = self.incidents.send(&self.board.message());
        }
        if changed {
            let _ = self.events.notify(Event::IncidentsChanged);
            self.status.tell_incidents(self.board.sentences());
            self.write_status();
        }
    }

    /// The model is never changed by it: a person decides what to make of it.
    fn watch_the_model(&mut self) {
        let Some(state) = self.newest else { return };
        if let Some(suspicion) = self.model.look(&state) {
            self.board.begin(Incident::ModelNoLongerExplains, &suspicion.to_string());
            // Nobody is woken on a broken bus, and its other users say so.
            let _ = self.events.notify(Event::ModelNoLongerExplains);
        }
        let suspected = self.model.suspected().map(|suspicion| suspicion.to_string());
        if suspected.is_none() {
            self.board.end(Incident::ModelNoLongerExplains);
        }
        self.status.suspect(suspected);
    }

    /// A place that is sought is no failure, but the worker must move for it, and a person may help.
    fn watch_the_place(&self) {
        let Some(state) = &self.newest else { return };
        if state.validity().any_of(Validity::PLACE_UNKNOWN) {
            self.board.begin(
                Incident::PlaceUnknown,
                "the suit was started anew or was silent for long; where the worker stands is found while they move \
                 without a load",
            );
        } else {
            self.board.end(Incident::PlaceUnknown);
        }
    }

    fn tidy(&mut self) {
        self.supervision.tidy(&self.bus, &self.board, self.status.loop_faults());
        let dead = self.bus.clean_up_dead_nodes();
        if dead > 0 {
            self.board.happened(
                Incident::ParticipantDied,
                &format!("{dead} participants of the bus had died; what they left behind is cleared away"),
            );
        }
        // The watchdog is fed with completed cycles, not with this thread being alive.
        let cycle = self.rings.last_cycle();
        if cycle != self.last_cycle {
            self.last_cycle = cycle;
            let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
        }
        self.watch_the_model();
        self.status.note_threads(&self.roster, cycle);
        self.write_status();
    }

    fn write_status(&self) {
        if let Err(error) = self.status.write() {
            warn!("cannot write {}: {error}", self.status.path.display());
        }
    }
}
