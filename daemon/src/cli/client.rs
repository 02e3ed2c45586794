//! What the commands that talk to a running daemon have in common.

use std::time::Duration;

use anyhow::bail;
use bytemuck::Zeroable;
use equipoise_bus::{Bus, BusSettings};
use equipoise_core::message::command::CommandKind;
use equipoise_core::message::{Command, State};

use crate::commands::text_of;

/// How long a daemon may take to answer or to publish a state.
const PATIENCE: Duration = Duration::from_secs(2);

/// Joins a station as a client.
pub(super) fn join(station: &str, role: &str) -> anyhow::Result<Bus> {
    Ok(Bus::join(&BusSettings::new(station, role))?)
}

/// Asks a running daemon; its answer is one sentence.
pub(super) fn ask(station: &str, kind: CommandKind, subject: &str) -> anyhow::Result<String> {
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
