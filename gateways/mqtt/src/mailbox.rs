//! Slot of one message between the publishing loop and the connection thread; a new message replaces one that still
//! waits.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A slot for one message.
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

/// Result of a call of `take`.
#[derive(Debug, PartialEq, Eq)]
pub enum Taken<T> {
    /// The newest message.
    Message(T),
    /// No message within the time-out.
    Nothing,
    /// The mailbox is closed.
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
    /// Stores a message and replaces one that still waits. Never blocks.
    pub fn put(&self, message: T) {
        let mut inner = self.inner();
        inner.replaced += u64::from(inner.waiting.replace(message).is_some());
        self.changed.notify_all();
    }

    /// Removes and returns the message; waits for one for at most `longest`.
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

    /// Waits for `long`, regardless of messages; returns false if the mailbox was closed.
    pub fn pause(&self, long: Duration) -> bool {
        let open = |inner: &mut Inner<T>| !inner.closed;
        let waited = self.changed.wait_timeout_while(self.inner(), long, open);
        !waited.unwrap_or_else(PoisonError::into_inner).0.closed
    }

    /// Closes the mailbox and wakes up the receiver.
    pub fn close(&self) {
        self.inner().closed = true;
        self.changed.notify_all();
    }

    /// Number of messages that were replaced before they were taken.
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
