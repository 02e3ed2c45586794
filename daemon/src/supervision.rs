//! Derives incidents from the messages of loop and adapters.
//!
//! This module reads the messages; the submodules evaluate them without access to clocks or files: observations are
//! inputs, and whether an incident is active is the output. Nothing here runs in the loop.

mod growth;
mod host_clock;
mod loop_time;
mod page_faults;
mod streams;

use equipoise_adapters::ground::GroundRefusal;
use equipoise_adapters::suit::SuitRefusal;
use equipoise_bus::{Bus, BusError, Subscriber};
use equipoise_config::{Config, GroundConfig, GroundSourceKind, SuitConfig, SuitSourceKind};
use equipoise_core::message::{AdapterHealth, CycleRecord, Incident, State, Validity};
use equipoise_core::time::seconds;
use equipoise_station::adapter_fault;

use self::growth::Growth;
use self::host_clock::{ClockMonitor, HostClock, StampCheck};
use self::loop_time::LoopTime;
use self::page_faults::PageFaults;
use self::streams::{StreamDescription, StreamMonitor, StreamSample, Verdict};
use crate::incidents::IncidentBoard;
use crate::realtime::now_ns;
use crate::rings::Refused;
use crate::sensors;

/// Time without observation (this process was stopped or had no core) does not prove silence: at most this much of the
/// interval between two evaluations counts.
const GAP_COUNTED_MAX_NS: u64 = 200_000_000;
/// Depth for all records of one evaluation interval at the highest rate, and of a delayed one.
const RECORDS: usize = 1024;

/// State of one of the two streams.
struct Stream {
    monitor: StreamMonitor,
    silent: Incident,
    stale: Incident,
    down: Incident,
    /// Role of its adapter on the bus, if the adapter is another process.
    external: Option<&'static str>,
    /// Whether such an adapter was ever present.
    was_present: bool,
}

/// The watches and their subscriptions.
pub struct Supervision {
    cycles: Subscriber<CycleRecord>,
    health: Subscriber<AdapterHealth>,
    last_update_ns: u64,
    /// Start time, before the first evaluation.
    started_ns: u64,
    suit: Stream,
    ground: Stream,
    input_overflow: Growth,
    output_overflow: Growth,
    deadlines: Growth,
    loop_time: LoopTime,
    clock: ClockMonitor,
    refused: Refused,
    page_faults: PageFaults,
}

impl Supervision {
    /// Subscribes to the required services.
    ///
    /// # Errors
    /// The bus fails.
    pub fn open(bus: &Bus, config: &Config) -> Result<Supervision, BusError> {
        Ok(Supervision {
            cycles: bus.subscriber(RECORDS)?,
            health: bus.subscriber(8)?,
            last_update_ns: now_ns(),
            started_ns: now_ns(),
            suit: Stream {
                monitor: StreamMonitor::new(describe_suit(&config.suit)),
                silent: Incident::SuitSilent,
                stale: Incident::SuitStampsStale,
                down: Incident::SuitAdapterDown,
                external: (!config.reads_suit()).then_some(sensors::SUIT_ROLE),
                was_present: false,
            },
            ground: Stream {
                monitor: StreamMonitor::new(describe_ground(&config.ground)),
                silent: Incident::GroundSilent,
                stale: Incident::GroundStampsStale,
                down: Incident::GroundAdapterDown,
                external: (!config.reads_ground()).then_some(sensors::GROUND_ROLE),
                was_present: false,
            },
            input_overflow: Growth::default(),
            output_overflow: Growth::default(),
            deadlines: Growth::default(),
            loop_time: LoopTime::default(),
            clock: ClockMonitor::default(),
            refused: Refused::default(),
            page_faults: PageFaults::default(),
        })
    }

    /// Evaluates all messages since the last call; `state` is the newest state, if any, and `refused` counts the
    /// samples that ingress has refused since the start.
    ///
    /// # Errors
    /// The bus fails.
    pub fn update(
        &mut self,
        state: Option<&State>,
        refused: Refused,
        board: &IncidentBoard,
    ) -> Result<(), BusError> {
        let now_ns = now_ns();
        let gap_ns = now_ns.saturating_sub(self.last_update_ns).min(GAP_COUNTED_MAX_NS);
        self.last_update_ns = now_ns;
        // An error of one service must not prevent the evaluation of the others.
        let health_result = self.receive_health();
        let (mut newest, mut ingested, mut stamps) = (None, [0, 0], StampCheck::default());
        while let Some(record) = self.cycles.receive()? {
            self.loop_time.ingest(&record);
            stamps.ingest(&record);
            ingested[0] += u64::from(record.suit_taken);
            ingested[1] += u64::from(record.ground_taken);
            newest = Some(record);
        }
        let before = std::mem::replace(&mut self.refused, refused);
        let new = [refused.suit - before.suit, refused.ground - before.ground];
        stamps.ingest_refused(new[0] + new[1], refused.ahead_ns);
        self.check_loop(newest.as_ref(), gap_ns, board);
        let Some(record) = newest else { return health_result };
        self.check_counts(&record, gap_ns, board);
        if let Some(state) = state {
            let newest_ns = |age_ns: u64| (age_ns < u64::MAX).then(|| state.time_ns.saturating_sub(age_ns));
            let sample = |ingested, age_ns| StreamSample { gap_ns, ingested, newest_ns: newest_ns(age_ns) };
            self.suit.check(sample(ingested[0] + new[0], state.suit_age_ns), board);
            self.ground.check(sample(ingested[1] + new[1], state.ground_age_ns), board);
            let unsynchronised =
                ingested[0] > 0 && Validity(state.valid).any_of(Validity::CLOCK_UNSYNCHRONISED);
            self.clock.ingest(unsynchronised, ingested[0] > 0, stamps, gap_ns);
        }
        if let Some(suspended_ns) = self.clock.tick(HostClock::read()) {
            let what = format!(
                "the computer slept for {:.1} s; all that was known then is old: switch suspend off (systemctl mask \
                 sleep.target)",
                seconds(suspended_ns)
            );
            board.report_once(Incident::ClockFault, &what);
        }
        let fault = self.clock.fault();
        board.set(Incident::ClockFault, fault.is_some(), || fault.unwrap_or_default());
        health_result
    }

    fn receive_health(&mut self) -> Result<(), BusError> {
        while let Some(health) = self.health.receive()? {
            match health.stream {
                1 => self.suit.monitor.ingest_health(&health),
                _ => self.ground.monitor.ingest_health(&health),
            }
        }
        Ok(())
    }

    /// Slower checks, once a second; `loop_faults` are the loop's minor and major page faults since its warm-up, if
    /// that is over.
    pub fn check_adapters(&mut self, bus: &Bus, board: &IncidentBoard, loop_faults: Option<[u64; 2]>) {
        self.clock.set_source(host_clock::source());
        if let Some(new) = self.page_faults.update(loop_faults) {
            board.begin(
                Incident::PageFaults,
                &format!(
                    "the loop took {new} page faults after its warm-up; lock memory ([loop] lock_memory, systemd: \
                     LimitMEMLOCK=infinity) and see `equipoise doctor`"
                ),
            );
        } else if !self.page_faults.is_active() {
            board.end(Incident::PageFaults);
        }
        if self.suit.external.is_none() && self.ground.external.is_none() {
            return;
        }
        let Ok(participants) = bus.participants() else { return };
        let is_overdue =
            self.last_update_ns.saturating_sub(self.started_ns) > streams::NEVER_STARTED_AFTER_NS;
        for stream in [&mut self.suit, &mut self.ground] {
            let Some(role) = stream.external else { continue };
            let is_present = participants.iter().any(|one| one.role == role);
            stream.was_present |= is_present;
            let fault = adapter_fault::read(bus.station(), role);
            if is_present {
                board.set(stream.down, fault.is_some(), || fault.unwrap_or_default());
                continue;
            }
            board.set(stream.down, stream.was_present || is_overdue, || {
                let ended = fault.map(|fault| format!("; its adapter ended: {fault}")).unwrap_or_default();
                format!(
                    "no process publishes {}{ended}. Start `equipoise adapter {role}` (systemd: `systemctl start \
                     equipoise-adapter@{role}`; why it ended: `journalctl -u equipoise-adapter@{role}`)",
                    stream.monitor.what()
                )
            });
        }
    }

    fn check_loop(&mut self, newest: Option<&CycleRecord>, gap_ns: u64, board: &IncidentBoard) {
        let is_hanging = self.loop_time.is_hanging(newest.is_some(), gap_ns);
        let was_hanging = board.is_active(Incident::LoopStalled);
        board.set(Incident::LoopStalled, is_hanging, || {
            "no cycle has ended for a second: the loop hangs, or has no core; systemd's watchdog restarts it".to_owned()
        });
        if let Some(stall) = self.loop_time.take_stall().filter(|_| !was_hanging) {
            board.report_once(Incident::LoopStalled, &stall.to_string());
        }
    }

    fn check_counts(&mut self, record: &CycleRecord, gap_ns: u64, board: &IncidentBoard) {
        let missed = self.deadlines.update(record.deadlines_missed, gap_ns);
        board.set(Incident::DeadlineMissed, missed, || {
            format!(
                "a cycle was ready only after the next was due: {} so far, {}; see `equipoise latency` and `equipoise doctor`",
                record.deadlines_missed,
                self.deadlines.last()
            )
        });
        let lost = self.input_overflow.update(record.input_dropped, gap_ns);
        board.set(Incident::InputOverflow, lost, || {
            format!(
                "{} samples so far were lost before the loop, {}, whose ring was full: it stood still, or a sensor sends \
                 faster than a cycle may take in",
                record.input_dropped,
                self.input_overflow.last()
            )
        });
        let lost = self.output_overflow.update(record.output_dropped, gap_ns);
        board.set(Incident::OutputOverflow, lost, || {
            format!(
                "{} states so far were lost behind the loop, {}: egress had no core for a quarter of a second",
                record.output_dropped,
                self.output_overflow.last()
            )
        });
    }
}

impl Stream {
    fn check(&mut self, sample: StreamSample, board: &IncidentBoard) {
        let verdict = self.monitor.update(sample);
        let message = |monitor: &StreamMonitor| monitor.message(verdict);
        board.set(self.silent, matches!(verdict, Verdict::NeverStarted | Verdict::Silent), || {
            message(&self.monitor)
        });
        board.set(self.stale, matches!(verdict, Verdict::Repeats | Verdict::Refused), || {
            message(&self.monitor)
        });
    }
}

fn describe_suit(config: &SuitConfig) -> StreamDescription {
    const TIME_REASONS: [usize; 3] =
        [SuitRefusal::Duplicate.index(), SuitRefusal::OutOfOrder.index(), SuitRefusal::Late.index()];
    let check = match config.source {
        SuitSourceKind::External => {
            "is `equipoise adapter suit` running, or the daemon that has this station in its suit.forwarded?"
                .to_owned()
        }
        SuitSourceKind::MvnUdp | SuitSourceKind::MvnTcp => format!(
            "is MVN's Network Streamer on, not paused, and does it send to {}{}?{}",
            config.listen,
            if config.source == SuitSourceKind::MvnTcp { " with Protocol TCP" } else { "" },
            if config.allow_remote { "" } else { " If MVN runs on another PC: suit.allow_remote" }
        ),
    };
    const REFUSED: &str =
        "; `equipoise doctor suit` says more (upside_down: if MVN sends with Y up, suit.up_axis = \"y\")";
    StreamDescription {
        what: "the suit",
        check,
        reasons: SuitRefusal::NAMES,
        refused: REFUSED,
        time_reasons: &TIME_REASONS,
    }
}

fn describe_ground(config: &GroundConfig) -> StreamDescription {
    const TIME_REASONS: [usize; 2] = [GroundRefusal::Duplicate.index(), GroundRefusal::OutOfOrder.index()];
    let check = match config.source {
        GroundSourceKind::External => "is `equipoise adapter ground` running?".to_owned(),
        GroundSourceKind::AtiRdt => {
            format!("is it on, and is {} right? Another client may have taken its stream", config.location())
        }
        _ => format!("is it on, and is {} right?", config.location()),
    };
    StreamDescription {
        what: "the plate",
        check,
        reasons: GroundRefusal::NAMES,
        refused: "",
        time_reasons: &TIME_REASONS,
    }
}
