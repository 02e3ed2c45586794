//! `equipoise record`: keeps what a station does in a file, or in files for as long as there is room.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use equipoise_config::Config;
use equipoise_recording::record::signature::{SigningKey, make_key};
use equipoise_recording::record::{RecordSummary, record, service};
use sd_notify::NotifyState;

use super::stop_on_signals;
use super::{Outcome, StationArgument, log_to_stderr};

/// Record a running station into an MCAP file, until Ctrl-C
///
/// Suit and ground samples, states, cycle records, checkpoints, adapters' counts, the configuration and the worker's
/// profile. `equipoise replay` does the same cycles again from it; Foxglove and Lichtblick show figure and state, and the
/// `mcap` tools read it too (docs/recordings.md).
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples: equipoise record shift.mcap --for 600\n          equipoise record --config \
                        /etc/equipoise/equipoise.toml\n          equipoise record --new-key recording.key\n\nA file is never overwritten. Exit code 3: messages were \
                        lost; the summary says which."
)]
pub(super) struct Arguments {
    /// File to create
    #[arg(value_name = "OUT.mcap", required_unless_present_any = ["config", "new_key"], conflicts_with = "config")]
    out: Option<PathBuf>,
    /// Sign the finished file with this key, into OUT.mcap.minisig; `minisign -V` and `equipoise report` verify it
    #[arg(long, value_name = "FILE", conflicts_with = "config")]
    sign_key: Option<PathBuf>,
    /// Record nothing, but make a key to sign with: a secret key without a password, and FILE.pub, the public key
    // Not `exclusive`: the station may be in the environment.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["out", "sign_key", "config", "seconds", "pictures_hz"])]
    new_key: Option<PathBuf>,
    /// Record for as long as the station runs, by the [recording] of a configuration: one file after the other, the oldest
    /// removed
    #[arg(long, value_name = "FILE", conflicts_with_all = ["seconds", "pictures_hz"])]
    config: Option<PathBuf>,
    #[command(flatten)]
    station: StationArgument,
    /// End by itself after so many seconds
    #[arg(long = "for", value_name = "SECONDS")]
    seconds: Option<f64>,
    /// Pictures a second for Foxglove and Lichtblick, 0 to 100; 0 leaves them out
    #[arg(long, value_name = "HZ", default_value_t = 20.0)]
    pictures_hz: f64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    if let Some(path) = &arguments.new_key {
        let public = make_key(path)?;
        println!("{} signs recordings; keep it secret", path.display());
        println!("{} verifies them; keep a copy on another machine", public.display());
        return Ok(Outcome::Done);
    }
    match (&arguments.out, &arguments.config) {
        (Some(out), _) => run_once(arguments, out),
        (None, Some(config)) => serve(config),
        (None, None) => bail!("name a file to create, or a configuration with --config"),
    }
}

fn run_once(arguments: &Arguments, out: &Path) -> anyhow::Result<Outcome> {
    let seconds = arguments.seconds.map(Duration::try_from_secs_f64).transpose();
    let length = seconds.map_err(|_| anyhow!("--for: give a positive number of seconds, for example 600"))?;
    if !(0.0..=100.0).contains(&arguments.pictures_hz) {
        bail!("--pictures-hz {}: give 0 to 100; 0 leaves pictures out", arguments.pictures_hz);
    }
    let key = arguments.sign_key.as_deref().map(SigningKey::read).transpose().context("--sign-key")?;
    let stop = stop_on_signals()?;
    let started = Instant::now();
    let stopping =
        || stop.load(Ordering::Relaxed) || length.is_some_and(|length| started.elapsed() >= length);
    let (summary, sha256) =
        record(&arguments.station.station, out, arguments.pictures_hz, &stopping, || {
            eprintln!("recording station {} to {}", arguments.station.station, out.display());
        })?;
    println!("{}: {summary}", out.display());
    if let Some(key) = &key {
        key.sign(out, &sha256)?;
    }
    Ok(outcome(&summary))
}

fn serve(path: &Path) -> anyhow::Result<Outcome> {
    log_to_stderr("info");
    let config = Config::read(path)?;
    let recording = config.recording.as_ref().with_context(|| {
        format!(
            "{} has no [recording]: add it, with directory = \"/var/lib/equipoise/recordings\" for example",
            path.display()
        )
    })?;
    let stop = stop_on_signals()?;
    let heartbeat = || {
        let _ = sd_notify::notify(&[NotifyState::Ready, NotifyState::Watchdog]);
    };
    let base = path.parent().unwrap_or(Path::new(""));
    let summary =
        service::serve(&config.station, recording, base, &|| stop.load(Ordering::Relaxed), &heartbeat)?;
    let _ = sd_notify::notify(&[NotifyState::Stopping]);
    println!("{summary}");
    // Losses are in the journal; a service that stops on request has not failed.
    Ok(Outcome::Done)
}

fn outcome(summary: &RecordSummary) -> Outcome {
    if summary.lost() == 0 { Outcome::Done } else { Outcome::PartRejected }
}
