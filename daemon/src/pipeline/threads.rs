//! Starting threads and waiting for them.

use std::sync::mpsc;
use std::thread::JoinHandle;

use anyhow::{Context, anyhow, bail};
use equipoise_latency::Report;

use crate::tick::LoopSummary;

/// Stack of every thread; the loop's is prefaulted, and locked memory counts each.
const STACK_BYTES: usize = 2 << 20;

/// A thread that has nothing to say at its end.
pub(super) type Other = (&'static str, JoinHandle<anyhow::Result<()>>);

/// The threads that were started so far.
#[derive(Default)]
pub(super) struct Running {
    pub(super) looping: Option<JoinHandle<anyhow::Result<LoopSummary>>>,
    pub(super) egress: Option<JoinHandle<anyhow::Result<Report>>>,
    pub(super) others: Vec<Other>,
}

impl Running {
    pub(super) fn is_whole(&self) -> bool {
        fn runs<T>(thread: &Option<JoinHandle<T>>) -> bool {
            thread.as_ref().is_some_and(|thread| !thread.is_finished())
        }
        runs(&self.looping)
            && runs(&self.egress)
            && self.others.iter().all(|(_, thread)| !thread.is_finished())
    }

    /// Waits for every thread, so that each takes what it owns off the bus; then tells what they ended with.
    pub(super) fn join(self) -> anyhow::Result<(LoopSummary, Report)> {
        let cycles = self.looping.map(|thread| joined("loop", thread));
        let latency = self.egress.map(|thread| joined("egress", thread));
        let others: Vec<_> = self.others.into_iter().map(|(name, thread)| joined(name, thread)).collect();
        others.into_iter().collect::<anyhow::Result<()>>()?;
        match (cycles, latency) {
            (Some(cycles), Some(latency)) => Ok((cycles?, latency?)),
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

/// Starts a thread and waits until it says that it is ready; if it ends before, that is the error.
pub(super) fn started<Ready: Send + 'static, T: Send + 'static>(
    name: &'static str,
    body: impl FnOnce(mpsc::Sender<Ready>) -> anyhow::Result<T> + Send + 'static,
) -> anyhow::Result<(JoinHandle<anyhow::Result<T>>, Ready)> {
    let (sender, receiver) = mpsc::channel();
    let thread =
        std::thread::Builder::new().name(name.into()).stack_size(STACK_BYTES).spawn(move || body(sender))?;
    match receiver.recv() {
        Ok(ready) => Ok((thread, ready)),
        Err(_) => match thread.join() {
            Ok(Err(error)) => Err(error),
            _ => Err(anyhow!("thread {name} ended before it began")),
        },
    }
}
