//! Starts and joins threads.

use std::sync::Arc;
use std::sync::mpsc::{self, Sender};
use std::thread::JoinHandle;

use anyhow::{Context, anyhow, bail};
use equipoise_latency::{PathHistograms, Report};

use crate::in_force::InForce;
use crate::realtime::Asked;
use crate::roster::Roster;
use crate::tick::LoopSummary;
use crate::workers::Workers;

/// Stack size of every thread; the loop's is prefaulted, and each counts as locked memory.
const STACK_BYTES: usize = 2 << 20;

/// A thread without a result.
pub(super) type Other = (&'static str, JoinHandle<anyhow::Result<()>>);

/// Data that the command thread receives once it owns the station.
pub(super) type Held = (Arc<InForce>, Arc<Workers>);

/// The threads started so far.
pub(super) struct Running {
    commands: JoinHandle<anyhow::Result<()>>,
    /// The command thread owns the station while this sender exists.
    hold: Sender<Held>,
    pub(super) looping: Option<JoinHandle<anyhow::Result<LoopSummary>>>,
    /// A failure costs latency figures only, so the other threads continue.
    pub(super) latency_log: Option<JoinHandle<anyhow::Result<Report>>>,
    pub(super) others: Vec<Other>,
    /// A failure affects nothing else.
    pub(super) metrics: Option<JoinHandle<anyhow::Result<()>>>,
}

impl Running {
    /// With the command thread only.
    pub(super) fn holding(commands: JoinHandle<anyhow::Result<()>>, hold: Sender<Held>) -> Running {
        Running { commands, hold, looping: None, latency_log: None, others: Vec::new(), metrics: None }
    }

    pub(super) fn is_whole(&self) -> bool {
        fn runs<T>(thread: &Option<JoinHandle<T>>) -> bool {
            thread.as_ref().is_some_and(|thread| !thread.is_finished())
        }
        runs(&self.looping)
            && !self.commands.is_finished()
            && self.others.iter().all(|(_, thread)| !thread.is_finished())
    }

    /// Joins all threads, so that each removes its ports from the bus; then returns their results. `last` is called
    /// before the station is released.
    pub(super) fn join(self, last: impl FnOnce()) -> anyhow::Result<(LoopSummary, Report)> {
        let cycles = self.looping.map(|thread| joined("loop", thread));
        let latency = self.latency_log.map(|thread| {
            joined("latency log", thread).unwrap_or_else(|error| {
                tracing::warn!("{error:#}; the figures of this run are lost, and nothing else");
                Report::of(&PathHistograms::new())
            })
        });
        let others: Vec<_> = self.others.into_iter().map(|(name, thread)| joined(name, thread)).collect();
        if let Some(Err(error)) = self.metrics.map(|thread| joined("metrics", thread)) {
            tracing::warn!("{error:#}; nothing else was touched by it");
        }
        last();
        drop(self.hold);
        joined("commands", self.commands)?;
        others.into_iter().collect::<anyhow::Result<()>>()?;
        match (cycles, latency) {
            (Some(cycles), Some(latency)) => Ok((cycles?, latency)),
            _ => bail!("the pipeline was not started whole"),
        }
    }
}

fn joined<T>(name: &'static str, thread: JoinHandle<anyhow::Result<T>>) -> anyhow::Result<T> {
    match thread.join() {
        Ok(outcome) => outcome.with_context(|| format!("thread {name}")),
        Err(_) => Err(anyhow!("thread {name} panicked")),
    }
}

/// Starts a thread, which requests its real-time settings first, and waits until it is ready; an earlier end is the
/// error.
pub(super) fn started<Ready: Send + 'static, T: Send + 'static>(
    name: &'static str,
    asked: Asked,
    roster: &Arc<Roster>,
    body: impl FnOnce(Sender<Ready>) -> anyhow::Result<T> + Send + 'static,
) -> anyhow::Result<(JoinHandle<anyhow::Result<T>>, Ready)> {
    let (sender, receiver) = mpsc::channel();
    let roster = Arc::clone(roster);
    let begin = move || {
        roster.ask(name, asked);
        body(sender)
    };
    let thread = std::thread::Builder::new().name(name.into()).stack_size(STACK_BYTES).spawn(begin)?;
    match receiver.recv() {
        Ok(ready) => Ok((thread, ready)),
        Err(_) => match thread.join() {
            Ok(Err(error)) => Err(error),
            _ => Err(anyhow!("thread {name} ended before it began")),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::time::Duration;

    #[test]
    fn the_station_is_given_free_when_all_is_written_and_the_status_is_gone() {
        let order = Arc::new(Mutex::new(Vec::new()));
        let note = |what: &'static str| {
            let order = Arc::clone(&order);
            move || order.lock().unwrap().push(what)
        };
        let (hold, held) = mpsc::channel::<Held>();
        let (free, saved) = (note("free"), note("saved"));
        let commands = std::thread::spawn(move || {
            let _ = held.recv();
            free();
            Ok(())
        });
        let mut running = Running::holding(commands, hold);
        let saving = std::thread::spawn(move || {
            // Simulates a slow disk.
            std::thread::sleep(Duration::from_millis(100));
            saved();
            Ok(())
        });
        running.others.push(("saving", saving));
        assert!(running.join(note("status")).is_err(), "there is no loop");
        assert_eq!(*order.lock().unwrap(), ["saved", "status", "free"]);
    }
}
