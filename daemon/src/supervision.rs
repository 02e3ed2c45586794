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
use equipoise_core::message::{AdapterHealth, CycleRecord, Incident, State, Validity};
use equipoise_core::time::seconds;

use self::growth::Growth;
use self::host_clock::{ClockWatch, HostClock, Stamped};
use self::loop_time::LoopTime;
use self::page_faults::PageFaults;
use self::streams::{StreamLook, StreamWatch, Verdict, Wire};
use crate::adapter_fault;
use crate::config::{Config, GroundConfig, GroundSourceKind, SuitConfig, SuitSourceKind};
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
    watch: StreamWatch,
    silent: Incident,
    stale: Incident,
    down: Incident,
    /// Role of its adapter on the bus, if the adapter is another process.
    external: Option<&'static str>,
    /// Whether such an adapter was ever present.
    was_there: bool,
}

/// The watches and their subscriptions.
pub struct Supervision {
    cycles: Subscriber<CycleRecord>,
    health: Subscriber<AdapterHealth>,
    last_look_ns: u64,
    /// Start time, before the first evaluation.
    started_ns: u64,
    suit: Stream,
    ground: Stream,
    input_overflow: Growth,
    output_overflow: Growth,
    deadlines: Growth,
    loop_time: LoopTime,
    clock: ClockWatch,
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
            last_look_ns: now_ns(),
            started_ns: now_ns(),
            suit: Stream {
                watch: StreamWatch::new(suit_wire(&config.suit)),
                silent: Incident::SuitSilent,
                stale: Incident::SuitStampsStale,
                down: Incident::SuitAdapterDown,
                external: (!config.reads_suit()).then_some(sensors::SUIT_ROLE),
                was_there: false,
            },
            ground: Stream {
                watch: StreamWatch::new(ground_wire(&config.ground)),
                silent: Incident::GroundSilent,
                stale: Incident::GroundStampsStale,
                down: Incident::GroundAdapterDown,
                external: (!config.reads_ground()).then_some(sensors::GROUND_ROLE),
                was_there: false,
            },
            input_overflow: Growth::default(),
            output_overflow: Growth::default(),
            deadlines: Growth::default(),
            loop_time: LoopTime::default(),
            clock: ClockWatch::default(),
            refused: Refused::default(),
            page_faults: PageFaults::default(),
        })
    }

    /// Evaluates all messages since the last call; `state` is the newest state, if any, and `refused` counts the
    /// samples that ingress has refused since the start.
    ///
    /// # Errors
    /// The bus fails.
    pub fn look(
        &mut self,
        state: Option<&State>,
        refused: Refused,
        board: &IncidentBoard,
    ) -> Result<(), BusError> {
        let now_ns = now_ns();
        let gap_ns = now_ns.saturating_sub(self.last_look_ns).min(GAP_COUNTED_MAX_NS);
        self.last_look_ns = now_ns;
        // An error of one service must not prevent the evaluation of the others.
        let heard = self.hear_health();
        let (mut newest, mut taken, mut stamped) = (None, [0, 0], Stamped::default());
        while let Some(record) = self.cycles.receive()? {
            self.loop_time.see(&record);
            stamped.see(&record);
            taken[0] += u64::from(record.suit_taken);
            taken[1] += u64::from(record.ground_taken);
            newest = Some(record);
        }
        let before = std::mem::replace(&mut self.refused, refused);
        let new = [refused.suit - before.suit, refused.ground - before.ground];
        stamped.see_refused(new[0] + new[1], refused.ahead_ns);
        self.judge_loop(newest.as_ref(), gap_ns, board);
        let Some(record) = newest else { return heard };
        self.judge_counts(&record, gap_ns, board);
        if let Some(state) = state {
            let newest_ns = |age_ns: u64| (age_ns < u64::MAX).then(|| state.time_ns.saturating_sub(age_ns));
            let look = |taken, age_ns| StreamLook { gap_ns, taken, newest_ns: newest_ns(age_ns) };
            self.suit.judge(look(taken[0] + new[0], state.suit_age_ns), board);
            self.ground.judge(look(taken[1] + new[1], state.ground_age_ns), board);
            let unsynchronised = taken[0] > 0 && Validity(state.valid).any_of(Validity::CLOCK_UNSYNCHRONISED);
            self.clock.see(unsynchronised, taken[0] > 0, stamped, gap_ns);
        }
        if let Some(slept_ns) = self.clock.tick(HostClock::read()) {
            let what = format!(
                "the computer slept for {:.1} s; all that was known then is old: switch suspend off (systemctl mask \
                 sleep.target)",
                seconds(slept_ns)
            );
            board.happened(Incident::ClockTrouble, &what);
        }
        let trouble = self.clock.trouble();
        board.set(Incident::ClockTrouble, trouble.is_some(), || trouble.unwrap_or_default());
        heard
    }

    fn hear_health(&mut self) -> Result<(), BusError> {
        while let Some(health) = self.health.receive()? {
            match health.stream {
                1 => self.suit.watch.hear(&health),
                _ => self.ground.watch.hear(&health),
            }
        }
        Ok(())
    }

    /// Slower checks, once a second; `loop_faults` are the loop's minor and major page faults since its warm-up, if
    /// that is over.
    pub fn tidy(&mut self, bus: &Bus, board: &IncidentBoard, loop_faults: Option<[u64; 2]>) {
        self.clock.name_source(host_clock::source());
        if let Some(new) = self.page_faults.look(loop_faults) {
            board.begin(
                Incident::PageFaults,
                &format!(
                    "the loop took {new} page faults after its warm-up; lock memory ([loop] lock_memory, systemd: \
                     LimitMEMLOCK=infinity) and see `equipoise doctor`"
                ),
            );
        } else if !self.page_faults.goes_on() {
            board.end(Incident::PageFaults);
        }
        if self.suit.external.is_none() && self.ground.external.is_none() {
            return;
        }
        let Ok(participants) = bus.participants() else { return };
        let long_enough = self.last_look_ns.saturating_sub(self.started_ns) > streams::NEVER_CAME_AFTER_NS;
        for stream in [&mut self.suit, &mut self.ground] {
            let Some(role) = stream.external else { continue };
            let is_there = participants.iter().any(|one| one.role == role);
            stream.was_there |= is_there;
            let fault = adapter_fault::read(bus.station(), role);
            if is_there {
                board.set(stream.down, fault.is_some(), || fault.unwrap_or_default());
                continue;
            }
            board.set(stream.down, stream.was_there || long_enough, || {
                let ended = fault.map(|fault| format!("; its adapter ended: {fault}")).unwrap_or_default();
                format!(
                    "no process publishes {}{ended}. Start `equipoise adapter {role}` (systemd: `systemctl start \
                     equipoise-adapter@{role}`; why it ended: `journalctl -u equipoise-adapter@{role}`)",
                    stream.watch.what()
                )
            });
        }
    }

    fn judge_loop(&mut self, newest: Option<&CycleRecord>, gap_ns: u64, board: &IncidentBoard) {
        let stands = self.loop_time.stands(newest.is_some(), gap_ns);
        let was_standing = board.is_active(Incident::LoopStalled);
        board.set(Incident::LoopStalled, stands, || {
            "no cycle has ended for a second: the loop hangs, or has no core; systemd's watchdog restarts it".to_owned()
        });
        if let Some(stall) = self.loop_time.take_stall().filter(|_| !was_standing) {
            board.happened(Incident::LoopStalled, &stall.to_string());
        }
    }

    fn judge_counts(&mut self, record: &CycleRecord, gap_ns: u64, board: &IncidentBoard) {
        let missed = self.deadlines.goes_on(record.deadlines_missed, gap_ns);
        board.set(Incident::DeadlineMissed, missed, || {
            format!(
                "a cycle was ready only after the next was due: {} so far, {}; see `equipoise latency` and `equipoise doctor`",
                record.deadlines_missed,
                self.deadlines.last()
            )
        });
        let lost = self.input_overflow.goes_on(record.input_dropped, gap_ns);
        board.set(Incident::InputOverflow, lost, || {
            format!(
                "{} samples so far were lost before the loop, {}, whose ring was full: it stood still, or a sensor sends \
                 faster than a cycle may take in",
                record.input_dropped,
                self.input_overflow.last()
            )
        });
        let lost = self.output_overflow.goes_on(record.output_dropped, gap_ns);
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
    fn judge(&mut self, look: StreamLook, board: &IncidentBoard) {
        let verdict = self.watch.look(look);
        let sentence = |watch: &StreamWatch| watch.sentence(verdict);
        board.set(self.silent, matches!(verdict, Verdict::NeverCame | Verdict::Silent), || {
            sentence(&self.watch)
        });
        board.set(self.stale, matches!(verdict, Verdict::Repeats | Verdict::Refused), || {
            sentence(&self.watch)
        });
    }
}

fn suit_wire(config: &SuitConfig) -> Wire {
    const OF_TIME: [usize; 3] =
        [SuitRefusal::Duplicate.index(), SuitRefusal::OutOfOrder.index(), SuitRefusal::Late.index()];
    let check = match config.source {
        SuitSourceKind::External => {
            "is `equipoise adapter suit` running, or the daemon that has this station in its suit.others?"
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
        "; `equipoise doctor suit` says more (upside_down: if MVN sends with Y up, suit.up = \"y\")";
    Wire { what: "the suit", check, reasons: SuitRefusal::NAMES, refused: REFUSED, of_time: &OF_TIME }
}

fn ground_wire(config: &GroundConfig) -> Wire {
    const OF_TIME: [usize; 2] = [GroundRefusal::Duplicate.index(), GroundRefusal::OutOfOrder.index()];
    let check = match config.source {
        GroundSourceKind::External => "is `equipoise adapter ground` running?".to_owned(),
        GroundSourceKind::AtiRdt => {
            format!("is it on, and is {} right? Another client may have taken its stream", config.place())
        }
        _ => format!("is it on, and is {} right?", config.place()),
    };
    Wire { what: "the plate", check, reasons: GroundRefusal::NAMES, refused: "", of_time: &OF_TIME }
}
