//! `equipoise record`: keeps what a station does in a file.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::anyhow;

use super::run::stop_on_signals;
use super::{Outcome, StationArgument};
use crate::record::record;

/// Record a running station into an MCAP file, until Ctrl-C
///
/// Suit and ground samples, states, cycle records, checkpoints, adapters' counts, the configuration and the worker's
/// profile. `equipoise replay` does the same cycles again from it; Foxglove and the `mcap` tools read it too.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise record shift.mcap --for 600\n\nA file is never overwritten. Exit code 3: \
                        messages were lost; the summary says which."
)]
pub(super) struct Arguments {
    /// File to create
    #[arg(value_name = "OUT.mcap")]
    out: PathBuf,
    #[command(flatten)]
    station: StationArgument,
    /// End by itself after so many seconds
    #[arg(long = "for", value_name = "SECONDS")]
    seconds: Option<f64>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let seconds = arguments.seconds.map(Duration::try_from_secs_f64).transpose();
    let length = seconds.map_err(|_| anyhow!("--for: give a positive number of seconds, for example 600"))?;
    let stop = stop_on_signals()?;
    let begun = Instant::now();
    let stopping = || stop.load(Ordering::Relaxed) || length.is_some_and(|length| begun.elapsed() >= length);
    let out = &arguments.out;
    let summary = record(&arguments.station.station, out, &stopping, || {
        eprintln!("recording station {} to {}", arguments.station.station, out.display());
    })?;
    println!("{}: {summary}", out.display());
    Ok(if summary.lost() == 0 { Outcome::Done } else { Outcome::PartRejected })
}
