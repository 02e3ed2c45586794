//! `equipoise adapter`: one adapter as a process of its own, so that its crash takes nothing else along.

use std::sync::atomic::Ordering;

use anyhow::bail;
use clap::ValueEnum;
use tracing::{info, warn};

use super::{ConfigArgument, Outcome, log_to_stderr};
use crate::config::{Config, GroundSourceKind, SuitSourceKind};
use crate::{realtime, sensors};

/// Run one adapter as a process of its own; the daemon's config then says source = "external"
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: equipoise adapter suit --config /etc/equipoise/suit.toml")]
pub(super) struct Arguments {
    stream: Stream,
    #[command(flatten)]
    config: ConfigArgument,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Stream {
    /// The motion-capture suit
    Suit,
    /// The force plate
    Ground,
}

impl Stream {
    fn name(self) -> &'static str {
        match self {
            Stream::Suit => "suit",
            Stream::Ground => "ground",
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    log_to_stderr("info");
    let config = Config::read(&arguments.config.config)?;
    let stop = super::run::stop_on_signals()?;
    let stopping = || stop.load(Ordering::Relaxed);
    let report = realtime::ask(arguments.stream.name(), sensors::asked(&config));
    match report.missing() {
        Some(missing) if config.tick.strict => bail!("loop.strict: {missing}"),
        Some(missing) => warn!("{missing}"),
        None => {}
    }
    let mut ready = || {
        info!(
            fifo_asked = report.asked.fifo_priority,
            fifo_granted = report.granted.fifo_priority,
            "station {}: the {} adapter runs",
            config.station,
            arguments.stream.name()
        );
        let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
    };
    match arguments.stream {
        Stream::Suit if config.suit.source == SuitSourceKind::External => external("suit")?,
        Stream::Ground if config.ground.source == GroundSourceKind::External => external("ground")?,
        Stream::Suit => sensors::run_suit(&config.station, &config.suit, &mut ready, &stopping)?,
        Stream::Ground => {
            let trouble = |sentence: Option<&str>| match sentence {
                Some(sentence) => warn!("{sentence}"),
                None => info!("the ground's device is there"),
            };
            sensors::run_ground(&config.station, &config.ground, &mut ready, &trouble, &stopping)?;
        }
    }
    Ok(Outcome::Done)
}

fn external(stream: &str) -> anyhow::Result<()> {
    bail!(
        "{stream}.source is \"external\" in this file: it is for the daemon; give the adapter one with the device"
    )
}
