//! A subscriber to a station's states.

use crate::clock::now_ns;
use crate::early::EarlyReading;
use crate::reading::{NoReading, Reading};
use crate::reporting::Reporting;
use crate::sequence::{Classification, Sequence};
use equipoise_bus::{Bus, BusError, BusSettings, Channel, Listener, Subscriber, Topic};
use equipoise_core::message::{ConsumerReceipt, EarlyState, State};
use std::time::Duration;

/// After this silence the consumer rejoins the bus, because the bus's directory may have been deleted and recreated
/// meanwhile, as by `systemctl stop` and `start`.
const REJOIN_AFTER: Duration = Duration::from_secs(2);
/// Longest single sleep, because a report may become due.
const SLEEP_MAX: Duration = Duration::from_millis(200);
/// Sleep while the bus is not joined, so that there is no listener to wait on.
const PAUSE: Duration = Duration::from_millis(20);

/// Settings of a consumer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConsumerSettings {
    /// Station, name of the consumer and root of the bus.
    pub bus: BusSettings,
    /// Maximum age of a returned state, counted from the due time of its cycle.
    pub stale_after: Duration,
    /// Length of the queue while the consumer is busy; 1 if only the newest state matters.
    pub depth: usize,
    /// Whether to publish a report on the delays of states.
    pub report: bool,
}

impl ConsumerSettings {
    /// Defaults of the service table ([`equipoise_bus::service`]): 25 ms, 8 states; with a report.
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

/// Subscribes to a station's states. Bound to the thread that joined.
#[derive(Debug)]
pub struct Consumer {
    settings: ConsumerSettings,
    ports: Option<Ports>,
    /// Why the bus was left; until it is read again.
    lost: Option<BusError>,
    /// Time of the last attempt to join.
    joined_ns: u64,
    /// [`REJOIN_AFTER`], shorter in tests.
    rejoin_after: Duration,
    /// Time of receipt of the last state, returned or not; before the first, the time of joining.
    last_received_ns: u64,
    sequence: Sequence,
    reporting: Reporting,
    last: Option<Reading>,
    /// The last early state and its time of receipt, ns.
    last_early: Option<(EarlyState, u64)>,
    /// States received, but not returned, since the last one returned.
    withheld: u64,
    missed: u64,
    restarted: bool,
    /// Number of daemon starts so far.
    daemon_life: u32,
    /// Why the newest state was not returned, if so.
    refused: Option<NoReading>,
}

/// Fields drop in order: ports must be dropped before their bus, so the bus is last.
#[derive(Debug)]
struct Ports {
    states: Subscriber<State>,
    /// Opened by the first call of [`Consumer::early`].
    early: Option<Subscriber<EarlyState>>,
    events: Listener,
    bus: Bus,
}

impl Ports {
    fn open(settings: &ConsumerSettings) -> Result<Ports, BusError> {
        let bus = Bus::join(&settings.bus)?;
        let events = bus.listener(Channel::Results)?;
        Ok(Ports { states: bus.subscriber(settings.depth)?, early: None, events, bus })
    }
}

impl Consumer {
    /// Joins a station as `name` (1 to 32 letters, digits, '-', '_'), with the bus root given by the environment. The
    /// daemon need not run yet.
    ///
    /// # Errors
    /// An invalid name or root, services of another release, or no free place for a reader.
    pub fn join(station: &str, name: &str) -> Result<Consumer, BusError> {
        Consumer::join_with(ConsumerSettings::new(station, name))
    }

    /// As [`Consumer::join`], with custom settings.
    ///
    /// # Errors
    /// As [`Consumer::join`], and a depth outside the limits of the service table.
    pub fn join_with(settings: ConsumerSettings) -> Result<Consumer, BusError> {
        let ports = Ports::open(&settings)?;
        let mut reporting = Reporting::new(&settings.bus.role, settings.report);
        reporting.open(&ports.bus);
        Ok(Consumer {
            settings,
            ports: Some(ports),
            lost: None,
            joined_ns: now_ns(),
            rejoin_after: REJOIN_AFTER,
            last_received_ns: now_ns(),
            sequence: Sequence::default(),
            reporting,
            last: None,
            last_early: None,
            refused: None,
            withheld: 0,
            missed: 0,
            restarted: false,
            daemon_life: 0,
        })
    }

    /// Returns the next state not yet returned, oldest first; sleeps until one arrives or `timeout` has passed.
    ///
    /// States that are too old are skipped, so it may take longer than one period. A state wakes the caller at once;
    /// the time-out is coarse, a few milliseconds late at a 250 Hz kernel tick.
    ///
    /// # Errors
    /// The reason why there is no current state. All except [`NoReading::Bus`] are normal: call again.
    pub fn next(&mut self, timeout: Duration) -> Result<Reading, NoReading> {
        let begun_ns = now_ns();
        let mut passed_over = None;
        loop {
            while let Some(state) = self.receive(Subscriber::receive)? {
                match self.check_age(state) {
                    Some(Ok(reading)) => {
                        // A caller slower than the loop never reaches the wait below, so the report is published here,
                        // too.
                        self.report();
                        return Ok(reading);
                    }
                    Some(Err(reason)) => passed_over = Some(reason),
                    None => {}
                }
            }
            // Before the time-out check, so that the consumer rejoins even if the time-out is zero.
            self.keep_up()?;
            let waited = Duration::from_nanos(now_ns().saturating_sub(begun_ns));
            if waited >= timeout {
                return Err(passed_over.unwrap_or_else(|| self.why_none()));
            }
            self.sleep((timeout - waited).min(SLEEP_MAX))?;
        }
    }

    /// Returns the newest state without waiting, for callers with a period of their own. It may have been returned
    /// before (`is_new`), but is never older than `stale_after`.
    ///
    /// # Errors
    /// As [`Consumer::next`].
    pub fn latest(&mut self) -> Result<Reading, NoReading> {
        let newest = self.receive(Subscriber::latest)?.and_then(|state| self.check_age(state));
        if let Some(outcome) = newest {
            self.report();
            return outcome;
        }
        // Only after reading: if the caller's period is long, rejoining first would discard queued states, and mistake
        // the caller's pause for silence.
        self.keep_up()?;
        let now_ns = now_ns();
        let again = self.last.map(|reading| Reading { is_new: false, ..reading.at(now_ns) });
        again.filter(|reading| self.is_fresh(reading.age_ns)).ok_or_else(|| self.why_none())
    }

    /// Returns the newest early state without waiting: the result about the newest suit sample, with a larger σ than the
    /// state's. It may have been returned before (`is_new`), but is never older than its service's deadline.
    ///
    /// The first call subscribes; an early state arrives before the event that wakes [`Consumer::next`].
    ///
    /// # Errors
    /// As [`Consumer::next`].
    pub fn early(&mut self) -> Result<EarlyReading, NoReading> {
        let newest = self.receive_early().map_err(|error| self.lose_ports(error))?;
        let now_ns = now_ns();
        if let Some(early) = newest {
            self.last_received_ns = now_ns;
            let reading = EarlyReading::at(early, now_ns, true, now_ns);
            if matches!(reading, Err(NoReading::OtherClock { .. })) {
                return reading;
            }
            // One that is left over from an earlier daemon is not new.
            if self.last_early.is_none_or(|(last, _)| early.time_ns > last.time_ns) {
                self.last_early = Some((early, now_ns));
                return reading;
            }
        }
        // A rejoin would discard queued states; if there are any, the joined bus is still in use.
        if self.must_rejoin() && self.receive(Subscriber::latest)?.is_some() {
            self.last_received_ns = now_ns;
        }
        self.keep_up()?;
        let again = match self.last_early {
            Some((early, received_ns)) => EarlyReading::at(early, received_ns, false, now_ns),
            None => Err(NoReading::Silent {
                silent: Duration::from_nanos(now_ns.saturating_sub(self.last_received_ns)),
            }),
        };
        again.map_err(|reason| self.bus_error_or(reason))
    }

    fn receive_early(&mut self) -> Result<Option<EarlyState>, BusError> {
        let Some(Ports { early, bus, .. }) = &mut self.ports else { return Ok(None) };
        let subscriber = match early {
            Some(subscriber) => subscriber,
            None => early.insert(bus.subscriber(EarlyState::SERVICE.depth)?),
        };
        let newest = subscriber.latest()?;
        self.lost = None;
        Ok(newest)
    }

    /// An endless iterator over the results of [`Consumer::next`].
    pub fn readings(&mut self, timeout: Duration) -> impl Iterator<Item = Result<Reading, NoReading>> + '_ {
        std::iter::repeat_with(move || self.next(timeout))
    }

    /// Report on the delays of states so far. Published once a second while the consumer is read.
    pub fn receipt_report(&self) -> &ConsumerReceipt {
        self.reporting.report()
    }

    /// Why the report is not published although enabled, for example because all places are taken. Reading is not
    /// affected.
    pub fn report_refusal(&self) -> Option<&BusError> {
        self.reporting.refusal()
    }

    fn receive(
        &mut self,
        read: impl FnOnce(&mut Subscriber<State>) -> Result<Option<State>, BusError>,
    ) -> Result<Option<(State, u128)>, NoReading> {
        let Some(ports) = &mut self.ports else { return Ok(None) };
        match read(&mut ports.states) {
            Ok(state) => {
                self.lost = None;
                Ok(state.map(|state| (state, ports.states.writer())))
            }
            Err(error) => Err(self.lose_ports(error)),
        }
    }

    /// Stamps and counts a state; `None` if it is old, an error if it must not be returned.
    fn check_age(&mut self, (state, writer): (State, u128)) -> Option<Result<Reading, NoReading>> {
        let now_ns = now_ns();
        if let Some(ahead_ns) = state.time_ns.checked_sub(now_ns).filter(|ahead_ns| *ahead_ns > 0) {
            // Before the sequence check: otherwise all correct states would count as old until this state's time is
            // reached.
            self.last_received_ns = now_ns;
            let reason = NoReading::OtherClock { ahead: Duration::from_nanos(ahead_ns) };
            self.refused = Some(reason.clone());
            return Some(Err(reason));
        }
        let order = self.sequence.classify(&state, writer);
        let Classification::New { missed, restarted, suit_sample_time_ns } = order else { return None };
        self.last_received_ns = now_ns;
        self.reporting.enter(now_ns, &state, missed, suit_sample_time_ns);
        // After a restart only the new daemon's missed states count: losses of the previous one cannot be determined,
        // and its withheld states no longer matter.
        self.missed = if restarted { missed } else { self.missed + self.withheld + missed };
        self.restarted |= restarted;
        self.daemon_life += u32::from(restarted || self.daemon_life == 0);
        self.withheld = 0;
        let reading = Reading {
            state,
            received_ns: now_ns,
            age_ns: 0,
            sample_age_ns: None,
            missed: self.missed,
            restarted: self.restarted,
            daemon_life: self.daemon_life,
            is_new: true,
        };
        let outcome = self.check_freshness(reading.at(now_ns));
        self.refused = outcome.as_ref().err().cloned();
        match outcome {
            Ok(reading) => (self.last, self.missed, self.restarted) = (Some(reading), 0, false),
            Err(_) => self.withheld = 1,
        }
        Some(outcome)
    }

    fn check_freshness(&self, reading: Reading) -> Result<Reading, NoReading> {
        if !self.is_fresh(reading.age_ns) {
            let stale_after = self.settings.stale_after;
            return Err(NoReading::Stale { age: Duration::from_nanos(reading.age_ns), stale_after });
        }
        Ok(reading)
    }

    fn is_fresh(&self, age_ns: u64) -> bool {
        Duration::from_nanos(age_ns) <= self.settings.stale_after
    }

    /// The bus error while the bus is lost. Otherwise `Silent`, unless a state was refused recently: calls between two
    /// states then repeat its reason.
    fn why_none(&self) -> NoReading {
        let silent = Duration::from_nanos(now_ns().saturating_sub(self.last_received_ns));
        let refused = self.refused.clone().filter(|_| silent <= self.settings.stale_after);
        self.bus_error_or(refused.unwrap_or(NoReading::Silent { silent }))
    }

    fn bus_error_or(&self, reason: NoReading) -> NoReading {
        self.lost.clone().map_or(reason, NoReading::Bus)
    }

    /// Between two states: publishes the report if it is due, and rejoins after a long silence.
    fn keep_up(&mut self) -> Result<(), NoReading> {
        self.report();
        if self.must_rejoin() {
            self.rejoin()?;
        }
        Ok(())
    }

    /// Whether nothing was received for so long that the bus may have been recreated.
    fn must_rejoin(&self) -> bool {
        let since_ns = self.last_received_ns.max(self.joined_ns);
        Duration::from_nanos(now_ns().saturating_sub(since_ns)) >= self.rejoin_after
    }

    /// Publishes the report if it is due.
    fn report(&mut self) {
        if let Some(ports) = &self.ports {
            self.reporting.keep_up(&ports.bus, now_ns());
        }
    }

    fn rejoin(&mut self) -> Result<(), NoReading> {
        // Leaves first, because the places held now may be the last ones.
        self.leave();
        self.joined_ns = now_ns();
        let ports = Ports::open(&self.settings).map_err(|error| self.lose_ports(error))?;
        self.reporting.open(&ports.bus);
        self.ports = Some(ports);
        Ok(())
    }

    fn leave(&mut self) {
        self.reporting.close();
        self.ports = None;
    }

    /// Leaves a broken bus; the consumer rejoins as after a silence.
    fn lose_ports(&mut self, error: BusError) -> NoReading {
        self.leave();
        self.lost = Some(error.clone());
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
    /// Publishes the final report, so that the counts are complete.
    fn drop(&mut self) {
        self.reporting.publish();
        self.leave();
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    fn settings(folder: &tempfile::TempDir, role: &str) -> ConsumerSettings {
        let mut settings = ConsumerSettings::new("test", role);
        settings.bus.root = folder.path().join("bus");
        settings
    }

    #[test]
    fn a_lost_bus_is_reported_until_it_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let mut consumer = Consumer::join_with(settings(&folder, "reader")).unwrap();
        consumer.rejoin_after = REJOIN_AFTER / 10;
        // The bus cannot be joined again.
        let root = std::mem::replace(&mut consumer.settings.bus.root, "not absolute".into());
        while matches!(consumer.next(Duration::ZERO), Err(NoReading::Silent { .. })) {
            std::thread::sleep(PAUSE);
        }
        // Some attempts to join, and the calls between them.
        let end_ns = now_ns() + REJOIN_AFTER.as_nanos() as u64;
        while now_ns() < end_ns {
            let reasons = [
                consumer.next(Duration::ZERO).unwrap_err(),
                consumer.latest().unwrap_err(),
                consumer.early().unwrap_err(),
            ];
            assert!(reasons.iter().all(|reason| matches!(reason, NoReading::Bus(_))), "{reasons:?}");
            std::thread::sleep(PAUSE);
        }
        consumer.settings.bus.root = root;
        while matches!(consumer.latest(), Err(NoReading::Bus(_))) {
            std::thread::sleep(PAUSE);
        }
        assert!(matches!(consumer.latest(), Err(NoReading::Silent { .. })));
    }

    #[test]
    fn states_without_early_states_keep_the_bus_joined() {
        let folder = tempfile::tempdir().unwrap();
        let settings = |role| settings(&folder, role);
        let bus = Bus::join(&settings("daemon").bus).unwrap();
        let states = bus.publisher::<State>().unwrap();
        let mut consumer = Consumer::join_with(settings("early")).unwrap();
        consumer.rejoin_after = REJOIN_AFTER / 10;
        let joined_ns = consumer.joined_ns;
        let mut poll_for = |duration: Duration, publishes: bool| {
            let end_ns = now_ns() + duration.as_nanos() as u64;
            while now_ns() < end_ns {
                if publishes {
                    states.send(&State { time_ns: now_ns(), ..State::zeroed() }).unwrap();
                }
                assert!(matches!(consumer.early(), Err(NoReading::Silent { .. })));
                std::thread::sleep(Duration::from_millis(20));
            }
            consumer.joined_ns
        };
        assert_eq!(poll_for(REJOIN_AFTER / 5, true), joined_ns);
        // States still in the queue postpone the rejoin once.
        assert_ne!(poll_for(REJOIN_AFTER / 2, false), joined_ns);
    }
}
