//! Taking part in a station as one who reads its states.

use crate::clock::now_ns;
use crate::reading::{NoReading, Reading};
use crate::reporting::Reporting;
use crate::sequence::{Place, Sequence};
use equipoise_bus::{Bus, BusError, BusSettings, Channel, Listener, Subscriber, Topic};
use equipoise_core::message::{PickUp, State};
use std::time::Duration;

/// After so long a silence everything is opened anew: the directory of the bus may have been removed and made again
/// meanwhile, as `systemctl stop` and `start` do.
const REJOIN_AFTER: Duration = Duration::from_secs(2);
/// The longest that is slept at once: a report may be due meanwhile.
const SLEEP_MAX: Duration = Duration::from_millis(200);
/// How long is slept where there is nothing to listen to.
const PAUSE: Duration = Duration::from_millis(20);

/// How a consumer reads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConsumerSettings {
    /// Station, name of the consumer and root of the bus.
    pub bus: BusSettings,
    /// A state is handed out only while it is younger than this, counted from when its cycle was due.
    pub stale_after: Duration,
    /// States that wait while the consumer is busy; 1 for who only wants the newest.
    pub depth: usize,
    /// Whether to publish how late states came.
    pub report: bool,
}

impl ConsumerSettings {
    /// As the table of services has it ([`equipoise_bus::service`]): 25 ms, 8 states; it reports.
    pub fn new(station: &str, name: &str) -> ConsumerSettings {
        let row = State::SERVICE;
        ConsumerSettings {
            bus: BusSettings::new(station, name),
            stale_after: row.deadline.unwrap_or(Duration::MAX),
            depth: row.depth,
            report: true,
        }
    }
}

/// Reads a station's states. Belongs to the thread that joined.
#[derive(Debug)]
pub struct Consumer {
    settings: ConsumerSettings,
    ports: Option<Ports>,
    /// When it was tried last to join.
    joined_ns: u64,
    /// When a state came last, handed out or not; before the first, when it was joined.
    heard_ns: u64,
    sequence: Sequence,
    reporting: Reporting,
    last: Option<Reading>,
    /// States picked up, but not handed out, since the last that was.
    withheld: u64,
    missed: u64,
    restarted: bool,
    /// Daemons heard so far.
    daemon_life: u32,
    /// Why the newest state was not handed out, if it was not.
    refused: Option<NoReading>,
}

/// Ports die before the bus they hang on, so it stands last.
#[derive(Debug)]
struct Ports {
    states: Subscriber<State>,
    events: Listener,
    bus: Bus,
}

impl Ports {
    fn open(settings: &ConsumerSettings) -> Result<Ports, BusError> {
        let bus = Bus::join(&settings.bus)?;
        let events = bus.listener(Channel::Results)?;
        Ok(Ports { states: bus.subscriber(settings.depth)?, events, bus })
    }
}

impl Consumer {
    /// Joins a station as `name` (1 to 32 letters, digits, '-', '_'), under the bus's root that the environment asks
    /// for. The daemon need not run yet.
    ///
    /// # Errors
    /// A name or root that cannot be used, another release's services, or no place left for a reader.
    pub fn join(station: &str, name: &str) -> Result<Consumer, BusError> {
        Consumer::join_with(ConsumerSettings::new(station, name))
    }

    /// As [`Consumer::join`], with settings of one's own.
    ///
    /// # Errors
    /// As [`Consumer::join`], and a depth that the table does not allow.
    pub fn join_with(settings: ConsumerSettings) -> Result<Consumer, BusError> {
        let ports = Ports::open(&settings)?;
        let mut reporting = Reporting::new(&settings.bus.role, settings.report);
        reporting.open(&ports.bus);
        Ok(Consumer {
            settings,
            ports: Some(ports),
            joined_ns: now_ns(),
            heard_ns: now_ns(),
            sequence: Sequence::default(),
            reporting,
            last: None,
            refused: None,
            withheld: 0,
            missed: 0,
            restarted: false,
            daemon_life: 0,
        })
    }

    /// The next state not yet handed out, oldest first; sleeps until one comes or `timeout` has passed.
    ///
    /// What is too old is passed over, so it may take longer than one period. A state wakes at once; the time-out is
    /// coarse, a few milliseconds late at a 250 Hz kernel tick.
    ///
    /// # Errors
    /// Why there is no current state. All but [`NoReading::Bus`] are ordinary: call again.
    pub fn next(&mut self, timeout: Duration) -> Result<Reading, NoReading> {
        let begun_ns = now_ns();
        let mut passed_over = None;
        loop {
            while let Some(state) = self.receive(Subscriber::receive)? {
                match self.pick_up(state) {
                    Some(Ok(reading)) => {
                        // Whoever is slower than the loop never waits below, and has a report to make as well.
                        self.report();
                        return Ok(reading);
                    }
                    Some(Err(reason)) => passed_over = Some(reason),
                    None => {}
                }
            }
            // Also for who never waits: nobody else joins anew.
            self.keep_up()?;
            let waited = Duration::from_nanos(now_ns().saturating_sub(begun_ns));
            if waited >= timeout {
                return Err(passed_over.unwrap_or_else(|| self.why_none()));
            }
            self.sleep((timeout - waited).min(SLEEP_MAX))?;
        }
    }

    /// The newest state there is, without waiting: for who has a rhythm of its own. It may have been handed out before
    /// (`is_new`), but is never older than `stale_after`.
    ///
    /// # Errors
    /// As [`Consumer::next`].
    pub fn latest(&mut self) -> Result<Reading, NoReading> {
        let picked_up = self.receive(Subscriber::latest)?.and_then(|state| self.pick_up(state));
        if let Some(outcome) = picked_up {
            self.report();
            return outcome;
        }
        // Not before: whoever asks seldom would throw away what waits for it, and take its own pause for silence.
        self.keep_up()?;
        let now_ns = now_ns();
        let again = self.last.map(|reading| Reading { is_new: false, ..reading.at(now_ns) });
        again.filter(|reading| self.is_fresh(reading.age_ns)).ok_or_else(|| self.why_none())
    }

    /// One reading after the other, for ever, each as [`Consumer::next`] gives it.
    pub fn readings(&mut self, timeout: Duration) -> impl Iterator<Item = Result<Reading, NoReading>> + '_ {
        std::iter::repeat_with(move || self.next(timeout))
    }

    /// How late states came so far. Published once a second, as long as readings are asked for.
    pub fn pick_up_report(&self) -> &PickUp {
        self.reporting.report()
    }

    /// Why the report is not published, if it should be: all places may be taken. Reading does not suffer.
    pub fn report_refusal(&self) -> Option<&BusError> {
        self.reporting.refusal()
    }

    fn receive(
        &mut self,
        read: impl FnOnce(&mut Subscriber<State>) -> Result<Option<State>, BusError>,
    ) -> Result<Option<(State, u128)>, NoReading> {
        let Some(ports) = &mut self.ports else { return Ok(None) };
        match read(&mut ports.states) {
            Ok(state) => Ok(state.map(|state| (state, ports.states.writer()))),
            Err(error) => Err(self.lose_ports(error)),
        }
    }

    /// Stamps and counts a state; `None` if it is no news, a reason if it must not be handed out.
    fn pick_up(&mut self, (state, writer): (State, u128)) -> Option<Result<Reading, NoReading>> {
        let now_ns = now_ns();
        if let Some(ahead_ns) = state.time_ns.checked_sub(now_ns).filter(|ahead_ns| *ahead_ns > 0) {
            // Before it is taken in: else all honest states would be older than it until its time has come.
            self.heard_ns = now_ns;
            let reason = NoReading::OtherClock { ahead: Duration::from_nanos(ahead_ns) };
            self.refused = Some(reason.clone());
            return Some(Err(reason));
        }
        let Place::New { missed, restarted, suit_sample_time_ns } = self.sequence.take(&state, writer) else {
            return None;
        };
        self.heard_ns = now_ns;
        self.reporting.enter(now_ns, &state, missed, suit_sample_time_ns);
        // What the daemon before it did not get across is not known, and those of it that were withheld are no longer
        // of interest.
        self.missed = if restarted { missed } else { self.missed + self.withheld + missed };
        self.restarted |= restarted;
        self.daemon_life += u32::from(restarted || self.daemon_life == 0);
        self.withheld = 0;
        let reading = Reading {
            state,
            picked_up_ns: now_ns,
            age_ns: 0,
            moment_age_ns: None,
            missed: self.missed,
            restarted: self.restarted,
            daemon_life: self.daemon_life,
            is_new: true,
        };
        let outcome = self.judge(reading.at(now_ns));
        self.refused = outcome.as_ref().err().cloned();
        match outcome {
            Ok(reading) => (self.last, self.missed, self.restarted) = (Some(reading), 0, false),
            Err(_) => self.withheld = 1,
        }
        Some(outcome)
    }

    fn judge(&self, reading: Reading) -> Result<Reading, NoReading> {
        if !self.is_fresh(reading.age_ns) {
            let stale_after = self.settings.stale_after;
            return Err(NoReading::Stale { age: Duration::from_nanos(reading.age_ns), stale_after });
        }
        Ok(reading)
    }

    fn is_fresh(&self, age_ns: u64) -> bool {
        Duration::from_nanos(age_ns) <= self.settings.stale_after
    }

    /// Silence, unless states come and are refused: whoever asks more often than they come is told why each time.
    fn why_none(&self) -> NoReading {
        let silent = Duration::from_nanos(now_ns().saturating_sub(self.heard_ns));
        let refused = self.refused.clone().filter(|_| silent <= self.settings.stale_after);
        refused.unwrap_or(NoReading::Silent { silent })
    }

    /// Between two states: publishes the report if it is due, and joins anew after a long silence.
    fn keep_up(&mut self) -> Result<(), NoReading> {
        self.report();
        let now_ns = now_ns();
        let since_ns = self.heard_ns.max(self.joined_ns);
        if Duration::from_nanos(now_ns.saturating_sub(since_ns)) >= REJOIN_AFTER {
            self.rejoin()?;
        }
        Ok(())
    }

    /// Publishes the report if it is due.
    fn report(&mut self) {
        if let Some(ports) = &self.ports {
            self.reporting.keep_up(&ports.bus, now_ns());
        }
    }

    fn rejoin(&mut self) -> Result<(), NoReading> {
        // The places held now must be free first: they may be the last.
        self.leave();
        self.joined_ns = now_ns();
        let ports = Ports::open(&self.settings)?;
        self.reporting.open(&ports.bus);
        self.ports = Some(ports);
        Ok(())
    }

    fn leave(&mut self) {
        self.reporting.close();
        self.ports = None;
    }

    /// What is broken is given up, and joined anew like what is silent.
    fn lose_ports(&mut self, error: BusError) -> NoReading {
        self.leave();
        NoReading::Bus(error)
    }

    fn sleep(&mut self, longest: Duration) -> Result<(), NoReading> {
        let Some(ports) = &self.ports else {
            std::thread::sleep(longest.min(PAUSE));
            return Ok(());
        };
        let waited = ports.events.wait(longest);
        waited.map(|_| ()).map_err(|error| self.lose_ports(error))
    }
}

impl Drop for Consumer {
    /// The last word, so that the counts are whole.
    fn drop(&mut self) {
        self.reporting.publish();
        self.leave();
    }
}
