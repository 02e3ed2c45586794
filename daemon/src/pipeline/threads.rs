//! Starts and joins threads.

use std::sync::Arc;
use std::thread::JoinHandle;

use anyhow::{Context, anyhow, bail};
use crossbeam_channel::{Sender, bounded};
use equipoise_latency::{PathHistograms, Report};

use crate::active_configuration::SharedConfiguration;
use crate::realtime::RequestedScheduling;
use crate::subjects::Subjects;
use crate::thread_registry::ThreadRegistry;
use crate::tick::LoopSummary;

/// Stack size of every thread; the loop's is prefaulted, and each counts as locked memory.
const STACK_BYTES: usize = 2 << 20;

/// A thread without a result.
pub(super) type NamedThread = (&'static str, JoinHandle<anyhow::Result<()>>);

/// Data that the command thread receives once it owns the station.
pub(super) type Shared = (Arc<SharedConfiguration>, Arc<Subjects>);

/// The threads started so far.
pub(super) struct Running {
    commands: JoinHandle<anyhow::Result<()>>,
    /// The command thread owns the station while this sender exists.
    shared_sender: Sender<Shared>,
    pub(super) loop_thread: Option<JoinHandle<anyhow::Result<LoopSummary>>>,
    /// A failure costs latency figures only, so the other threads continue.
    pub(super) latency_log: Option<JoinHandle<anyhow::Result<Report>>>,
    pub(super) threads: Vec<NamedThread>,
    /// Threads whose failure affects nothing else.
    pub(super) independent: Vec<NamedThread>,
}

impl Running {
    /// With the command thread only.
    pub(super) fn with_commands(
        commands: JoinHandle<anyhow::Result<()>>,
        shared_sender: Sender<Shared>,
    ) -> Running {
        Running {
            commands,
            shared_sender,
            loop_thread: None,
            latency_log: None,
            threads: Vec::new(),
            independent: Vec::new(),
        }
    }

    /// Lets the command thread answer.
    pub(super) fn answer_commands(&self, shared: Shared) {
        let _ = self.shared_sender.send(shared);
    }

    pub(super) fn is_running(&self) -> bool {
        fn is_alive<T>(thread: &Option<JoinHandle<T>>) -> bool {
            thread.as_ref().is_some_and(|thread| !thread.is_finished())
        }
        is_alive(&self.loop_thread)
            && !self.commands.is_finished()
            && self.threads.iter().all(|(_, thread)| !thread.is_finished())
    }

    /// Joins all threads, so that each removes its ports from the bus; then returns their results. `last` is called
    /// before the station is released.
    pub(super) fn join(self, last: impl FnOnce()) -> anyhow::Result<(LoopSummary, Report)> {
        let cycles = self.loop_thread.map(|thread| join_thread("loop", thread));
        let latency = self.latency_log.map(|thread| {
            join_thread("latency log", thread).unwrap_or_else(|error| {
                tracing::warn!("{error:#}; the figures of this run are lost, and nothing else");
                Report::of(&PathHistograms::new())
            })
        });
        let threads: Vec<_> =
            self.threads.into_iter().map(|(name, thread)| join_thread(name, thread)).collect();
        for (name, thread) in self.independent {
            if let Err(error) = join_thread(name, thread) {
                tracing::warn!("{error:#}; nothing else was touched by it");
            }
        }
        last();
        drop(self.shared_sender);
        join_thread("commands", self.commands)?;
        threads.into_iter().collect::<anyhow::Result<()>>()?;
        match (cycles, latency) {
            (Some(cycles), Some(latency)) => Ok((cycles?, latency)),
            _ => bail!("the pipeline was not started whole"),
        }
    }
}

fn join_thread<T>(name: &'static str, thread: JoinHandle<anyhow::Result<T>>) -> anyhow::Result<T> {
    match thread.join() {
        Ok(outcome) => outcome.with_context(|| format!("thread {name}")),
        Err(_) => Err(anyhow!("thread {name} panicked")),
    }
}

/// Starts a thread, which requests its real-time settings first, and waits until it is ready; an earlier end is the
/// error.
pub(super) fn start_thread<Ready: Send + 'static, T: Send + 'static>(
    name: &'static str,
    requested: RequestedScheduling,
    thread_registry: &Arc<ThreadRegistry>,
    body: impl FnOnce(Sender<Ready>) -> anyhow::Result<T> + Send + 'static,
) -> anyhow::Result<(JoinHandle<anyhow::Result<T>>, Ready)> {
    let (sender, receiver) = bounded(1);
    let thread_registry = Arc::clone(thread_registry);
    let begin = move || {
        thread_registry.request(name, requested);
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
    fn the_station_is_released_after_all_files_are_written() {
        let order = Arc::new(Mutex::new(Vec::new()));
        let mark = |what: &'static str| {
            let order = Arc::clone(&order);
            move || order.lock().unwrap().push(what)
        };
        let (shared_sender, shared) = bounded::<Shared>(1);
        let (free, saved) = (mark("free"), mark("saved"));
        let commands = std::thread::spawn(move || {
            let _ = shared.recv();
            free();
            Ok(())
        });
        let mut running = Running::with_commands(commands, shared_sender);
        let saving = std::thread::spawn(move || {
            // Simulates a slow disk.
            std::thread::sleep(Duration::from_millis(100));
            saved();
            Ok(())
        });
        running.threads.push(("saving", saving));
        assert!(running.join(mark("status")).is_err(), "there is no loop");
        assert_eq!(*order.lock().unwrap(), ["saved", "status", "free"]);
    }
}
