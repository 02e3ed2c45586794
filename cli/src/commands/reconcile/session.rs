//! `reconcile --session`: records a station, evaluates what was recorded so far at each Enter, and asks for the next
//! measurement until the finding is decided.

use std::io::{BufRead, stdin};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context;
use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};
use equipoise_config::LoadedModel;
use equipoise_discrepancy::finding::Finding;
use equipoise_discrepancy::workflow::output::check_verdicts;
use equipoise_recording::record::record;

use super::super::{Outcome, stop_on_signals};
use super::Arguments;

/// The session's recording in the folder of the results.
const RECORDING: &str = "session.mcap";
/// Interval at which a signal or the end of the recording is noticed.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Foxglove's pictures are not needed.
const PICTURES_HZ: f64 = 0.0;

/// Why the engineer is waited for no longer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    /// Evaluate what was recorded so far.
    Evaluate,
    /// End of input, a signal, or the end of the recording.
    End,
}

/// Records and evaluates until the finding is decided, the input ends or a signal comes; then writes the results.
pub(super) fn run(arguments: &Arguments, folder: &Path) -> anyhow::Result<Outcome> {
    // Before anything is recorded.
    let loaded = arguments.model.as_deref().map(LoadedModel::read).transpose()?;
    check_verdicts(folder, loaded.as_ref().map(LoadedModel::file))?;
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let recording = folder.join(RECORDING);
    let interrupted = stop_on_signals()?;
    let lines = lines();
    let is_decided = AtomicBool::new(false);
    let station = &arguments.station.station;
    let stopping = || is_decided.load(Ordering::Relaxed) || interrupted.load(Ordering::Relaxed);
    let started = || {
        eprintln!(
            "recording station {station} to {}: let the worker hold the poses, if not identified yet, and work; \
             Enter evaluates, Ctrl-C ends",
            recording.display()
        );
    };
    std::thread::scope(|scope| {
        let recorder = scope.spawn(|| record(station, &recording, PICTURES_HZ, &stopping, started));
        // Ends the recording after an error, too: the scope waits for the recorder.
        let end = EndRecording(&is_decided);
        let is_over = || interrupted.load(Ordering::Relaxed) || recorder.is_finished();
        while wait(&lines, &is_over) == Next::Evaluate {
            match super::evaluate(arguments, &recording, None) {
                Ok(evaluated) => {
                    // The file is still written: its end is missing, which is no fault.
                    evaluated.print_finding(arguments)?;
                    if evaluated.outcome.finding.decided {
                        break;
                    }
                    eprintln!("{}", request(&evaluated.outcome.finding));
                }
                // Too little was recorded yet.
                Err(error) => eprintln!("not yet: {error:#}"),
            }
        }
        drop(end);
        match recorder.join() {
            Ok(recorded) => recorded.map(drop),
            Err(panic) => std::panic::resume_unwind(panic),
        }
    })?;
    // The recording is complete now, and its hash is that of the file.
    super::one(arguments, &recording, Some(folder))
}

/// Ends the recording when dropped.
struct EndRecording<'a>(&'a AtomicBool);

impl Drop for EndRecording<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// The lines of standard input; disconnected at its end.
fn lines() -> Receiver<String> {
    // A piped input is read no faster than it is evaluated.
    let (sender, receiver) = bounded(1);
    // Not joined: a read from a terminal cannot be interrupted.
    std::thread::spawn(move || {
        for line in stdin().lock().lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}

fn wait(lines: &Receiver<String>, is_over: &dyn Fn() -> bool) -> Next {
    while !is_over() {
        match lines.recv_timeout(POLL_INTERVAL) {
            Ok(_) => return Next::Evaluate,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Next::End,
        }
    }
    Next::End
}

/// What the worker should do next.
fn request(finding: &Finding) -> String {
    match &finding.ask {
        Some(ask) => format!("now: {}; then Enter (Ctrl-C ends)", ask.what()),
        None => {
            "no known measurement would tell more; continue the work, then Enter (Ctrl-C ends)".to_owned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_in_an_evaluation_ends_the_recording() {
        let is_decided = AtomicBool::new(false);
        let failed: anyhow::Result<()> = std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_decided.load(Ordering::Relaxed) {
                    std::thread::sleep(Duration::from_millis(1));
                }
            });
            let _end = EndRecording(&is_decided);
            anyhow::bail!("standard output is closed");
        });
        assert!(failed.is_err());
    }
}
