//! The screen: drawn ten times a second, controlled by keys. It restores the terminal when it ends, and ends with it.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use equipoise_config::model::suggestion;
use equipoise_daemon::realtime::now_ns;
use equipoise_view::banner::Banner;
use equipoise_view::watch::{Watch, draw};
use ratatui::DefaultTerminal;
use ratatui::crossterm::terminal::disable_raw_mode;
use rustix::termios::tcgetattr;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::iterator::Signals;

use super::Until;
use super::keys::{self, Pressed};
use super::subscriptions::Subscriptions;

/// Interval at which the screen is drawn and adapts to a new size; a key draws it immediately.
const DRAW_INTERVAL: Duration = Duration::from_millis(100);
/// After a signal the screen ends with its next drawing. A write that takes longer than this is blocked: the terminal
/// accepts no output (flow control, a stopped multiplexer).
const BLOCKED_AFTER: Duration = Duration::from_secs(2);

/// Shows the station until a key, a signal, the time or the end of the terminal ends it.
pub(super) fn run(station: &str, until: &Until) -> anyhow::Result<()> {
    // Restore the terminal, too, when it is closed or a core dump is requested.
    for signal in [SIGHUP, SIGQUIT] {
        signal_hook::flag::register(signal, Arc::clone(&until.stop))?;
    }
    let mut subscriptions = Subscriptions::open(station)?;
    // It also restores the terminal before a panic is reported.
    let mut terminal = ratatui::try_init().context("cannot draw on this terminal")?;
    let writes = Arc::new(AtomicU64::new(0));
    end_if_blocked(Arc::clone(&writes))?;
    let result = draw_until(&mut terminal, station, &mut subscriptions, until, &writes);
    let restored = counted(&writes, ratatui::try_restore);
    if restored.is_err() {
        // Dropping it would show the cursor and print that this failed: a panic where standard error is closed, too.
        std::mem::forget(terminal);
    }
    match (result.context("cannot draw on this terminal")?, restored) {
        (End::TerminalGone, _) => Ok(()),
        (End::Requested, Err(_)) if is_terminal_gone() => Ok(()),
        (End::Requested, restored) => restored.context("cannot restore the terminal: type `reset`"),
    }
}

/// Counts the begin and the end of a write: the number is odd while one is in progress.
fn counted<T>(writes: &AtomicU64, write: impl FnOnce() -> T) -> T {
    writes.fetch_add(1, Ordering::Relaxed);
    let result = write();
    writes.fetch_add(1, Ordering::Relaxed);
    result
}

/// Ends the process if a write is blocked after a signal: it does not return for a flag. A process that merely waits for
/// a processor ends by itself.
fn end_if_blocked(writes: Arc<AtomicU64>) -> io::Result<()> {
    let mut signals = Signals::new([SIGTERM, SIGINT, SIGHUP, SIGQUIT])?;
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        if signals.forever().next().is_none() {
            return;
        }
        loop {
            let before = writes.load(Ordering::Relaxed);
            std::thread::sleep(BLOCKED_AFTER);
            if before % 2 == 1 && writes.load(Ordering::Relaxed) == before {
                // The other screen cannot be left, which needs a write.
                let _ = disable_raw_mode();
                std::process::exit(1);
            }
        }
    })?;
    Ok(())
}

/// Why the screen ended.
enum End {
    Requested,
    TerminalGone,
}

fn draw_until(
    terminal: &mut DefaultTerminal,
    station: &str,
    subscriptions: &mut Subscriptions,
    until: &Until,
    writes: &AtomicU64,
) -> io::Result<End> {
    let stdin = io::stdin();
    let mut help = false;
    let mut banner = Banner::default();
    while !until.is_over() {
        subscriptions.update();
        let state = subscriptions.state();
        let (pose, sensors) =
            (state.and_then(|state| suggestion(state, subscriptions.ask.as_ref())), subscriptions.sensors());
        let headline = state.map(|state| banner.update(state, pose.as_deref()));
        let watch = Watch {
            station,
            subject: &subscriptions.subject,
            state,
            stopped: subscriptions.stopped,
            silent_s: subscriptions.silent_s(),
            headline,
            pose: pose.as_deref(),
            sensors: &sensors,
            incidents: subscriptions.incidents.as_ref(),
            latency: subscriptions.latency.as_ref(),
            now_ns: now_ns(),
            help,
        };
        match counted(writes, || terminal.draw(|frame| draw(frame, &watch)).map(|_| ())) {
            Ok(()) => {}
            Err(_) if is_terminal_gone() => return Ok(End::TerminalGone),
            Err(error) => return Err(error),
        }
        let drawn = Instant::now();
        while let Some(remaining) = DRAW_INTERVAL.checked_sub(drawn.elapsed()).filter(|_| !until.is_over()) {
            match keys::wait(&stdin, remaining) {
                Pressed::Nothing => {}
                Pressed::Help => {
                    help = !help;
                    break;
                }
                Pressed::Quit => return Ok(End::Requested),
                Pressed::Gone => return Ok(End::TerminalGone),
            }
        }
    }
    Ok(End::Requested)
}

/// A terminal that was closed has no settings. The error of a drawing does not tell: asked for the size of a closed
/// terminal, crossterm runs `tput` and returns whatever error came last.
fn is_terminal_gone() -> bool {
    tcgetattr(io::stdout()).is_err()
}
