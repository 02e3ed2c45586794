//! What must be done now and then: clearing away the dead, feeding the watchdog, telling incidents and status, looking
//! whether the model still explains what is measured. Nothing here waits for a disk: saving has a thread of its own.

use std::sync::Arc;
use std::time::{Duration, Instant};

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

/// A reason for which values are withheld, and the incident that it becomes.
struct Watched {
    reason: Validity,
    incident: Incident,
    /// So long it must last: work has moments of its own.
    after: Duration,
    sentence: &'static str,
}

const WATCHED: [Watched; 5] = [
    Watched {
        reason: Validity::PLACE_UNKNOWN,
        incident: Incident::PlaceUnknown,
        after: Duration::ZERO,
        sentence: "the suit was started anew or was silent for long; where the worker stands is found while they move \
                   without a load",
    },
    Watched {
        reason: Validity::GROUND_IMPLAUSIBLE,
        incident: Incident::GroundImplausible,
        after: Duration::ZERO,
        sentence: "what the plate shows leaps, repeats or pulls as under no person; it is believed again once it shows the \
                   worker's weight alone, or after the worker has stepped off",
    },
    Watched {
        reason: Validity::SUIT_IMPLAUSIBLE,
        incident: Incident::SuitImplausible,
        after: Duration::ZERO,
        sentence: "poses of the suit repeat, leap or come apart at the joints, and are not used",
    },
    Watched {
        reason: Validity::WEIGHT_MISSING,
        incident: Incident::WeightMissing,
        after: Duration::from_secs(3),
        sentence: "the ground carries less than the worker weighs: a foot beside the plate, a hand that leans on something, \
                   or a plate whose gain or zero has changed (tare it while nobody stands on it)",
    },
    Watched {
        reason: Validity::LOAD_NOT_AT_HANDS,
        incident: Incident::LoadElsewhere,
        after: Duration::from_secs(10),
        sentence: "the ground carries more than the worker weighs, and not where the hands are: something lies on the plate \
                   or is worn, or the plate's zero or gain, its place, or the worker's identification is wrong",
    },
];

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
    /// Since when each of [`WATCHED`] holds.
    told_since: [Option<Instant>; WATCHED.len()],
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
            told_since: [None; WATCHED.len()],
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
        self.watch_what_is_told();
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

    /// What the loop finds wrong with what it is told: no failure of the daemon, but a person must help, or at least know.
    fn watch_what_is_told(&mut self) {
        let Some(state) = &self.newest else { return };
        let valid = state.validity();
        for (index, watched) in WATCHED.iter().enumerate() {
            let holds = valid.any_of(watched.reason);
            let since = &mut self.told_since[index];
            *since = if holds { Some(since.unwrap_or_else(Instant::now)) } else { None };
            match *since {
                Some(since) if since.elapsed() >= watched.after => {
                    self.board.begin(watched.incident, watched.sentence);
                }
                Some(_) => {}
                None => self.board.end(watched.incident),
            }
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
        self.status.tell_incidents(self.board.sentences());
        self.write_status();
    }

    fn write_status(&self) {
        if let Err(error) = self.status.write() {
            warn!("cannot write {}: {error}", self.status.path.display());
        }
    }
}
