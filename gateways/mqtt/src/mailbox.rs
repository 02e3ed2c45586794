//! Channel of one message from the publishing loop to the connection thread; a new message replaces one that still
//! waits.

use std::convert::Infallible;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded, select_biased};

/// End of the publishing loop; dropping it closes the mailbox.
#[derive(Debug)]
pub struct Sending<T> {
    messages: Sender<T>,
    waiting: Receiver<T>,
    replaced: u64,
    _open: Sender<Infallible>,
}

/// End of the connection thread.
#[derive(Debug)]
pub struct Mailbox<T> {
    messages: Receiver<T>,
    closed: Receiver<Infallible>,
}

/// Creates both ends of an empty mailbox.
pub fn mailbox<T>() -> (Sending<T>, Mailbox<T>) {
    let (messages, waiting) = bounded(1);
    let (open, closed) = bounded(0);
    let mailbox = Mailbox { messages: waiting.clone(), closed };
    (Sending { messages, waiting, replaced: 0, _open: open }, mailbox)
}

impl<T> Sending<T> {
    /// Stores a message and replaces one that still waits. Never blocks.
    pub fn put(&mut self, mut message: T) {
        while let Err(TrySendError::Full(newer)) = self.messages.try_send(message) {
            message = newer;
            self.replaced += u64::from(self.waiting.try_recv().is_ok());
        }
    }

    /// Number of messages that were replaced before they were taken.
    pub fn replaced(&self) -> u64 {
        self.replaced
    }
}

impl<T> Mailbox<T> {
    /// Waits for a message; `None` if the mailbox is closed, even if a message still waits.
    pub fn take(&self) -> Option<T> {
        select_biased! {
            recv(self.closed) -> _ => None,
            recv(self.messages) -> message => message.ok(),
        }
    }

    /// Waits for `long`, regardless of messages; returns false if the mailbox was closed.
    pub fn pause(&self, long: Duration) -> bool {
        self.closed.recv_timeout(long) == Err(RecvTimeoutError::Timeout)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_wins_and_what_it_replaced_is_counted() {
        let (mut sending, mailbox) = mailbox();
        for message in 1..=5 {
            sending.put(message);
        }
        assert_eq!(mailbox.take(), Some(5));
        assert_eq!(sending.replaced(), 4);
        assert!(mailbox.pause(Duration::ZERO));
        sending.put(6);
        drop(sending);
        assert_eq!(mailbox.take(), None);
        assert!(!mailbox.pause(Duration::from_secs(60)));
    }
}
