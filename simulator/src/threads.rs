//! Threads that stop together: by a flag that each of them polls.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, JoinHandle};

/// Running threads. Dropping them stops them.
#[derive(Debug)]
pub(crate) struct Threads<Output> {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<io::Result<Output>>>,
}

impl<Output> Threads<Output> {
    /// None so far.
    pub(crate) fn new() -> Threads<Output> {
        Threads { stop: Arc::default(), threads: Vec::new() }
    }

    /// Adds a thread that runs until its end or until the flag is set.
    ///
    /// # Errors
    /// The thread could not be created.
    pub(crate) fn spawn(
        &mut self,
        name: &str,
        run: impl FnOnce(&AtomicBool) -> io::Result<Output> + Send + 'static,
    ) -> io::Result<()>
    where
        Output: Send + 'static,
    {
        let stop = Arc::clone(&self.stop);
        self.threads.push(Builder::new().name(name.into()).spawn(move || run(&stop))?);
        Ok(())
    }

    /// Whether all have ended.
    pub(crate) fn are_finished(&self) -> bool {
        self.threads.iter().all(JoinHandle::is_finished)
    }

    /// Waits for all of them.
    ///
    /// # Errors
    /// The first error that ended one of them early.
    pub(crate) fn join(&mut self) -> io::Result<Vec<Output>> {
        let ended: Vec<_> = self.threads.drain(..).map(join).collect();
        ended.into_iter().collect()
    }

    /// Stops all of them.
    ///
    /// # Errors
    /// As [`Self::join`].
    pub(crate) fn stop(&mut self) -> io::Result<Vec<Output>> {
        self.stop.store(true, Ordering::Relaxed);
        self.join()
    }
}

fn join<Output>(thread: JoinHandle<io::Result<Output>>) -> io::Result<Output> {
    let name = thread.thread().name().unwrap_or_default().to_owned();
    thread.join().unwrap_or_else(|_| Err(io::Error::other(format!("the simulator's thread {name} panicked"))))
}

impl<Output> Drop for Threads<Output> {
    fn drop(&mut self) {
        // Dropped without `stop`: errors are ignored.
        let _ = self.stop();
    }
}
