//! What the commands that talk to a running daemon have in common.

use std::time::Duration;

use anyhow::bail;
use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusSettings};
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{Command, State};

use crate::commands::text_of;
use crate::config::{Config, GroundSourceKind};

/// How long a daemon may take to answer or to publish a state.
const PATIENCE: Duration = Duration::from_secs(2);

/// Joins a station as a client.
pub(super) fn join(station: &str, role: &str) -> anyhow::Result<Bus> {
    Ok(Bus::join(&BusSettings::new(station, role))?)
}

/// Asks a running daemon; its answer is one sentence.
pub(crate) fn ask(station: &str, kind: CommandKind, subject: &str) -> anyhow::Result<String> {
    let mut command = Command { kind: kind as u32, ..Command::zeroed() };
    if subject.len() > command.subject.len() {
        bail!("a subject's id has at most {} letters", command.subject.len());
    }
    command.subject[..subject.len()].copy_from_slice(subject.as_bytes());
    let reply = join(station, "client")?.command_client()?.ask(&command, PATIENCE)?;
    let text = text_of(&reply.text);
    if reply.refused != 0 {
        bail!("refused: {text}");
    }
    Ok(text)
}

/// The newest state of a running daemon.
pub(super) fn newest_state(bus: &Bus) -> anyhow::Result<State> {
    let mut states = bus.subscriber::<State>(1)?;
    let started = std::time::Instant::now();
    while started.elapsed() < PATIENCE {
        if let Some(state) = states.latest()? {
            return Ok(state);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    bail!(
        "no daemon publishes on station {}; start one with `equipoise run --config FILE` or `equipoise demo`, or name \
         another with --station",
        bus.station()
    )
}

/// How long a stream may be silent that somebody waits for.
const SILENCE_MAX: Duration = Duration::from_secs(3);

/// When something was last heard of a stream; a command that waits for it ends if that is too long ago.
pub(super) struct Heard {
    what: &'static str,
    station: String,
    at: std::time::Instant,
}

impl Heard {
    /// `what` is how people call the stream.
    pub(super) fn new(what: &'static str, station: &str) -> Heard {
        Heard { what, station: station.to_owned(), at: std::time::Instant::now() }
    }

    /// It was heard just now.
    pub(super) fn now(&mut self) {
        self.at = std::time::Instant::now();
    }

    /// Fails once it has been silent for too long.
    pub(super) fn check(&self) -> anyhow::Result<()> {
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

/// That the daemon reads the plate itself, so that its file is the one that `key` stands in.
pub(super) fn own_ground(config: &Config, key: &str) -> anyhow::Result<()> {
    if config.ground.source == GroundSourceKind::External {
        bail!(
            "the plate is read by another process, whose own file holds {key}; run this with the plate's adapter in the \
             daemon ([ground] source is not \"external\" then), and copy what it finds into that file"
        );
    }
    Ok(())
}

/// The configuration that a station's daemon runs with.
pub(super) fn configuration_in_force(station: &str) -> anyhow::Result<Config> {
    let Some(facts) = crate::status::read(station) else {
        bail!("no daemon runs on station {station}; start one with `equipoise run --config FILE`");
    };
    Ok(Config::parse(&facts.config_toml, "the daemon's configuration")?)
}
