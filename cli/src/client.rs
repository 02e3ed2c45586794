//! Common functions of commands and page that communicate with a running daemon.

use std::cell::Cell;
use std::time::{Duration, Instant};

use anyhow::{anyhow, bail};
use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusSettings, Request, RequestClient, parse_text};
use equipoise_config::{Config, GroundSourceKind};
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::handover::HandoverRefusal;
use equipoise_core::message::{Command, HandoverPlan, HandoverRequest, Reply, State};
use equipoise_daemon::commands::{PLATE_LOADED_RECENTLY, PLATE_SILENT};
use equipoise_station::DAEMON_ROLE;
use equipoise_station::process_state::is_stopped;

/// Timeout of a daemon's reply, and of its next state: a busy machine delays a process for seconds.
const TIMEOUT: Duration = Duration::from_secs(20);
/// The same if the daemon's process is stopped.
const STOPPED_TIMEOUT: Duration = Duration::from_secs(2);
/// The same if no daemon is on the bus, also not at the end of this time.
const ABSENT_TIMEOUT: Duration = Duration::from_millis(500);

/// Joins a station's bus as a client.
pub(crate) fn join(station: &str, role: &str) -> anyhow::Result<Bus> {
    Ok(Bus::join(&BusSettings::new(station, role))?)
}

/// Sends a command to a running daemon; returns the reply, one sentence.
pub(crate) fn request(station: &str, kind: CommandKind, subject: &str) -> anyhow::Result<String> {
    let mut command = Command { kind: kind as u32, ..Command::zeroed() };
    if subject.len() > command.subject.len() {
        bail!("a subject's id has at most {} letters", command.subject.len());
    }
    command.subject[..subject.len()].copy_from_slice(subject.as_bytes());
    let bus = join(station, "client")?;
    let is_late = |reply: &Reply| [PLATE_SILENT, PLATE_LOADED_RECENTLY].contains(&&*parse_text(&reply.text));
    let reply = ask_while_late(&bus, &bus.command_client()?, &command, is_late)?;
    let text = parse_text(&reply.text);
    if reply.refused != 0 {
        bail!("refused: {text}");
    }
    Ok(text)
}

/// Requests a plan of a handover from a running daemon.
pub(crate) fn plan_handover(station: &str, request: &HandoverRequest) -> anyhow::Result<HandoverPlan> {
    let bus = join(station, "plan")?;
    let is_late = |plan: &HandoverPlan| plan.refused == HandoverRefusal::Stale as u32;
    ask_while_late(&bus, &bus.handover_client()?, request, is_late)
}

/// Repeats a request for a second while the response reports late data: on a busy machine the loop and the sensors stand
/// still for 100 ms now and then.
fn ask_while_late<Q: Request>(
    bus: &Bus,
    client: &RequestClient<Q>,
    request: &Q,
    is_late: impl Fn(&Q::Response) -> bool,
) -> anyhow::Result<Q::Response> {
    let started = Instant::now();
    loop {
        let response = ask(bus, client, request)?;
        if !is_late(&response) || started.elapsed() > Duration::from_secs(1) {
            return Ok(response);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn ask<Q: Request>(bus: &Bus, client: &RequestClient<Q>, request: &Q) -> anyhow::Result<Q::Response> {
    client.ask_until(request, end_of_wait(bus)).map_err(|error| match stopped_daemon(bus) {
        Some(stopped) => anyhow!(stopped),
        None => error.into(),
    })
}

/// The newest state of a running daemon.
pub(crate) fn newest_state(bus: &Bus) -> anyhow::Result<State> {
    let mut states = bus.subscriber::<State>(1)?;
    let (started, is_over) = (Instant::now(), end_of_wait(bus));
    while !is_over(started.elapsed()) {
        if let Some(state) = states.latest()? {
            return Ok(state);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    if let Some(stopped) = stopped_daemon(bus) {
        bail!(stopped);
    }
    bail!(
        "no daemon publishes on station {}; start one with `equipoise run --config FILE` or `equipoise demo`, or name \
         another with --station",
        bus.station()
    )
}

/// Process id of the station's daemon.
fn daemon_of(bus: &Bus) -> Option<u32> {
    Some(bus.participants().ok()?.iter().find(|one| one.role == DAEMON_ROLE)?.process_id)
}

/// Whether the daemon of the station is no longer waited for after a time.
fn end_of_wait(bus: &Bus) -> impl Fn(Duration) -> bool {
    let daemon = Cell::new(daemon_of(bus));
    move |waited| {
        if daemon.get().is_none() && waited > ABSENT_TIMEOUT {
            daemon.set(daemon_of(bus));
        }
        let is_over = match daemon.get() {
            Some(process) => waited > STOPPED_TIMEOUT && is_stopped(process),
            None => waited > ABSENT_TIMEOUT,
        };
        is_over || waited > TIMEOUT
    }
}

/// Description of a daemon whose process exists but does not respond; `None` if there is none.
fn stopped_daemon(bus: &Bus) -> Option<String> {
    let daemon = daemon_of(bus)?;
    let station = bus.station();
    Some(if is_stopped(daemon) {
        format!(
            "the daemon of station {station}, process {daemon}, is stopped: let it continue with `kill -CONT {daemon}`"
        )
    } else {
        format!(
            "the daemon of station {station}, process {daemon}, runs but does not answer: see its journal (`journalctl -u \
             equipoise`), and restart it if that does not help"
        )
    })
}

/// Maximum silence of a stream that a command waits for.
const SILENCE_MAX: Duration = Duration::from_secs(3);

/// Time of the last message of a stream; ends a waiting command after too long a silence.
pub(crate) struct StreamTimeout {
    what: &'static str,
    station: String,
    at: Instant,
}

impl StreamTimeout {
    /// `what` is the display name of the stream.
    pub(crate) fn new(what: &'static str, station: &str) -> StreamTimeout {
        StreamTimeout { what, station: station.to_owned(), at: Instant::now() }
    }

    /// Records a message at this instant.
    pub(crate) fn reset(&mut self) {
        self.at = Instant::now();
    }

    /// Fails after too long a silence.
    pub(crate) fn check(&self) -> anyhow::Result<()> {
        if self.at.elapsed() > SILENCE_MAX {
            bail!(
                "{} of station {} says nothing; `equipoise status` says why, or name another station with --station",
                self.what,
                self.station
            );
        }
        Ok(())
    }
}

/// Checks that the daemon reads the plate itself, so that `key` is in the daemon's own file.
pub(crate) fn own_ground(config: &Config, key: &str) -> anyhow::Result<()> {
    if config.ground.source == GroundSourceKind::External {
        bail!(
            "the plate is read by another process, whose own file holds {key}; run this with the plate's adapter in the \
             daemon ([ground] source is not \"external\" then), and copy what it finds into that file"
        );
    }
    Ok(())
}

/// The active configuration of a station's daemon.
pub(crate) fn active_configuration_of(station: &str) -> anyhow::Result<Config> {
    let Some(facts) = equipoise_station::status::read(station) else {
        bail!("no daemon runs on station {station}; start one with `equipoise run --config FILE`");
    };
    Ok(Config::parse(&facts.config_toml, "the daemon's configuration")?)
}
