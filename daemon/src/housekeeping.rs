//! Periodic tasks: removes dead nodes, publishes incidents and status, and checks whether the model still explains the
//! measurements. The bus's files and the status may be on a slow disk: saving and the watchdog have their own threads.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::{select, tick};
use equipoise_bus::{Bus, BusError, BusSettings, Channel, Event, Notifier, Publisher, Subscriber};
use equipoise_config::Config;
use equipoise_core::message::{Incident, Incidents, State, Validity};
use tracing::warn;

use crate::incidents::IncidentBoard;
use crate::model_watch::ModelWatch;
use crate::rings::LoopControl;
use crate::status_file::StatusFile;
use crate::supervision::Supervision;
use crate::thread_registry::ThreadRegistry;

/// Polling interval for incidents.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// All other tasks run once in this many polls: once a second.
const UPDATES_PER_CLEAN_UP: u32 = 20;

/// A validity flag and the incident that it raises.
struct ValidityIncident {
    reason: Validity,
    incident: Incident,
    /// Minimum duration before the incident begins, since short interruptions are part of normal work.
    after: Duration,
    message: &'static str,
}

const VALIDITY_INCIDENTS: [ValidityIncident; 5] = [
    ValidityIncident {
        reason: Validity::POSITION_UNKNOWN,
        incident: Incident::PositionUnknown,
        after: Duration::ZERO,
        message: "the worker's position on the plate is no longer known, because the suit was restarted, jumped or was \
                   silent for long, the computer was restarted, or the plate was moved; it is estimated again while the \
                   worker moves without a load",
    },
    ValidityIncident {
        reason: Validity::GROUND_IMPLAUSIBLE,
        incident: Incident::GroundImplausible,
        after: Duration::ZERO,
        message: "the plate's values jump, repeat or pull upwards as under no person; they are used again once they show \
                   the worker's weight alone, or after the worker has stepped off",
    },
    ValidityIncident {
        reason: Validity::SUIT_IMPLAUSIBLE,
        incident: Incident::SuitImplausible,
        after: Duration::ZERO,
        message: "poses of the suit repeat, jump or separate at the joints, and are not used; if the profile in use \
                   is another worker's, load the right one with `equipoise subject load`",
    },
    ValidityIncident {
        reason: Validity::WEIGHT_MISSING,
        incident: Incident::WeightMissing,
        after: Duration::from_secs(3),
        message: "the ground carries less than the worker weighs: a foot next to the plate, a hand that leans on something, \
                   or a plate whose gain or zero has changed (tare it while it is empty)",
    },
    ValidityIncident {
        reason: Validity::LOAD_NOT_AT_HANDS,
        incident: Incident::LoadNotAtHands,
        after: Duration::from_secs(10),
        message: "the ground carries more than the worker weighs, and not where the hands are: something lies on the plate \
                   or is worn, or the plate's zero or gain, its place, or the worker's identification is wrong",
    },
];

/// Housekeeping with its ports on the bus.
pub struct Housekeeping {
    states: Subscriber<State>,
    /// The newest state.
    newest: Option<State>,
    supervision: Supervision,
    incidents: Publisher<Incidents>,
    events: Notifier,
    model: ModelWatch,
    control: Arc<LoopControl>,
    board: Arc<IncidentBoard>,
    thread_registry: Arc<ThreadRegistry>,
    /// Value of the board's change counter at the last publication.
    published_changes: u64,
    /// Whether it was reported that some supervision is unavailable.
    error_reported: bool,
    status: StatusFile,
    /// Since when each of [`VALIDITY_INCIDENTS`] is active.
    active_since: [Option<Instant>; VALIDITY_INCIDENTS.len()],
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
            control,
            board,
            thread_registry,
            published_changes: 0,
            error_reported: false,
            status,
            active_since: [None; VALIDITY_INCIDENTS.len()],
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
        self.check_validity();
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

    /// Reports only; a person decides whether to change the model.
    fn check_model(&mut self) {
        let Some(state) = &self.newest else { return };
        if self.model.check(state, &self.board, &self.status) {
            // A failed bus is reported by its other users.
            let _ = self.events.notify(Event::ModelMismatch);
        }
    }

    /// Invalid input that the loop detects: not a failure of the daemon, but it requires a person's attention.
    fn check_validity(&mut self) {
        let Some(state) = &self.newest else { return };
        let valid = state.validity();
        for (index, entry) in VALIDITY_INCIDENTS.iter().enumerate() {
            let holds = valid.any_of(entry.reason);
            let since = &mut self.active_since[index];
            *since = if holds { Some(since.unwrap_or_else(Instant::now)) } else { None };
            match *since {
                Some(since) if since.elapsed() >= entry.after => {
                    self.board.begin(entry.incident, entry.message);
                }
                Some(_) => {}
                None => self.board.end(entry.incident),
            }
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_of_a_lost_position_names_every_cause() {
        let entry =
            VALIDITY_INCIDENTS.iter().find(|entry| entry.reason == Validity::POSITION_UNKNOWN).unwrap();
        for cause in
            ["suit was restarted", "jumped", "silent for long", "computer was restarted", "plate was moved"]
        {
            assert!(entry.message.contains(cause), "{cause}: {}", entry.message);
        }
    }
}
