//! `equipoise watch`: continuous display of a running daemon's state: a screen on a terminal, lines in a pipe.

mod keys;
mod screen;
mod subscriptions;

use std::io::{IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use equipoise_config::model::suggestion;
use equipoise_core::message::{Incidents, State};
use equipoise_daemon::realtime::now_ns;
use equipoise_station::status;
use equipoise_view::incident_words;
use equipoise_view::is_current;
use equipoise_view::terminal::live_line;

use super::status::requested_pose;
use super::{Outcome, StationArgument};
use crate::client;

/// After this long without a state nothing is shown as if it were new.
const SILENT_AFTER: Duration = Duration::from_secs(1);
/// How often a line is printed.
const LINE_INTERVAL: Duration = Duration::from_secs(1);
/// How often a signal or the end of the time is looked for between two lines.
const STOP_CHECK_INTERVAL: Duration = Duration::from_millis(50);

/// Show the state of a running daemon continuously
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise watch                     a screen, from 40 columns and 12 lines on; \
                        q quits, ? explains the signs\n  equipoise watch --for 60 | tee log  one line a second, as \
                        always where output or input is no terminal\n\nThe screen waits for a daemon that is not \
                        there, and goes on with the next one."
)]
pub(super) struct Arguments {
    #[command(flatten)]
    station: StationArgument,
    /// End after this many seconds
    #[arg(long = "for", value_name = "SECONDS", value_parser = super::seconds)]
    seconds: Option<f64>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let until =
        Until { stop: super::stop_on_signals()?, started: Instant::now(), seconds: arguments.seconds };
    let station = &arguments.station.station;
    if std::io::stdout().is_terminal() && std::io::stdin().is_terminal() {
        screen::run(station, &until)?;
    } else {
        lines(station, &until)?;
    }
    Ok(Outcome::Done)
}

/// When to end.
struct Until {
    stop: Arc<AtomicBool>,
    started: Instant,
    seconds: Option<f64>,
}

impl Until {
    fn is_over(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
            || self.seconds.is_some_and(|seconds| self.started.elapsed().as_secs_f64() >= seconds)
    }
}

fn lines(station: &str, until: &Until) -> anyhow::Result<()> {
    let bus = client::join(station, "watch")?;
    let mut state = client::newest_state(&bus)?;
    let mut states = bus.subscriber::<State>(1)?;
    let (mut board, mut incidents) = (bus.subscriber::<Incidents>(1)?, None);
    let mut out = std::io::stdout().lock();
    let ask = requested_pose(status::read(station).as_ref());
    let is_fresh = |state: &State| is_current(state.time_ns, now_ns(), SILENT_AFTER.as_nanos() as u64);
    let mut received = is_fresh(&state).then(Instant::now);
    // Print at least one line, however short the time and however long joining took.
    loop {
        if let Some(newer) = states.latest()?.filter(is_fresh) {
            (state, received) = (newer, Some(Instant::now()));
        }
        incidents = board.latest()?.or(incidents);
        if received.is_none_or(|received| received.elapsed() > SILENT_AFTER) {
            writeln!(out, "the daemon is silent")?;
        } else {
            let wrong = incidents.as_ref().and_then(|incidents| incident_words::line(incidents, now_ns()));
            let wrong = wrong.map_or_else(String::new, |wrong| format!(" | {wrong}"));
            let pose = suggestion(&state, ask.as_ref());
            writeln!(out, "{}{wrong}", live_line(&state, pose.as_deref()))?;
        }
        let printed = Instant::now();
        loop {
            // Before the interval's end, which a delayed process may have passed already.
            if until.is_over() {
                return Ok(());
            }
            let Some(remaining) = LINE_INTERVAL.checked_sub(printed.elapsed()) else { break };
            std::thread::sleep(remaining.min(STOP_CHECK_INTERVAL));
        }
    }
}
