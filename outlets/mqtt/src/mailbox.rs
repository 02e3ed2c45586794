//! Between the beat and the connection: one place, in which the newest message replaces the one before.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A mailbox.
#[derive(Debug)]
pub struct Mailbox<T> {
    inner: Mutex<Inner<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct Inner<T> {
    waiting: Option<T>,
    replaced: u64,
    closed: bool,
}

/// What was in the mailbox.
#[derive(Debug, PartialEq, Eq)]
pub enum Taken<T> {
    /// The newest message.
    Message(T),
    /// None came in time.
    Nothing,
    /// None will come any more.
    Closed,
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        Mailbox {
            inner: Mutex::new(Inner { waiting: None, replaced: 0, closed: false }),
            changed: Condvar::new(),
        }
    }
}

impl<T> Mailbox<T> {
    /// Puts a message in, in place of one that still waits. Never waits itself.
    pub fn put(&self, message: T) {
        let mut inner = self.inner();
        inner.replaced += u64::from(inner.waiting.replace(message).is_some());
        self.changed.notify_all();
    }

    /// Takes the message out, waiting for one up to `longest`.
    pub fn take(&self, longest: Duration) -> Taken<T> {
        let idle = |inner: &mut Inner<T>| inner.waiting.is_none() && !inner.closed;
        let waited = self.changed.wait_timeout_while(self.inner(), longest, idle);
        let (mut inner, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match inner.waiting.take() {
            _ if inner.closed => Taken::Closed,
            Some(message) => Taken::Message(message),
            None => Taken::Nothing,
        }
    }

    /// Waits `long`, whatever comes meanwhile; false if the mailbox was closed.
    pub fn pause(&self, long: Duration) -> bool {
        let open = |inner: &mut Inner<T>| !inner.closed;
        let waited = self.changed.wait_timeout_while(self.inner(), long, open);
        !waited.unwrap_or_else(PoisonError::into_inner).0.closed
    }

    /// Whoever takes is told that it is over.
    pub fn close(&self) {
        self.inner().closed = true;
        self.changed.notify_all();
    }

    /// Messages that were replaced before they were taken.
    pub fn replaced(&self) -> u64 {
        self.inner().replaced
    }

    fn inner(&self) -> MutexGuard<'_, Inner<T>> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_wins_and_what_it_replaced_is_counted() {
        let mailbox = Mailbox::default();
        for message in 1..=5 {
            mailbox.put(message);
        }
        assert_eq!(mailbox.take(Duration::ZERO), Taken::Message(5));
        assert_eq!(mailbox.replaced(), 4);
        assert_eq!(mailbox.take(Duration::ZERO), Taken::Nothing);
        mailbox.put(6);
        mailbox.close();
        assert_eq!(mailbox.take(Duration::from_secs(60)), Taken::Closed);
        assert!(!mailbox.pause(Duration::from_secs(60)));
    }
}
