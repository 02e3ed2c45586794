//! One ring between two threads: never a wait, whatever the other thread is doing.
//!
//! Queues for many threads let one wait for another that was interrupted in the middle of a push or pop. The loop stands
//! above all its neighbours, and would wait for ever for one that it has itself pushed off the core. With one thread at
//! each end nobody has to.

use std::fmt;
use std::sync::Mutex;

use rtrb::{Consumer, Producer, PushError, RingBuffer};

/// A ring of fixed size with one thread at each end; nothing allocates after its making.
///
/// Each end's lock is there for the compiler: it is only ever tried, never waited for. Two threads that share an end for
/// once may find the ring full or empty when it is not.
pub struct Ring<T> {
    producer: Mutex<Producer<T>>,
    consumer: Mutex<Consumer<T>>,
}

impl<T> Ring<T> {
    /// An empty ring.
    pub fn new(capacity: usize) -> Ring<T> {
        let (producer, consumer) = RingBuffer::new(capacity);
        Ring { producer: Mutex::new(producer), consumer: Mutex::new(consumer) }
    }

    /// Puts a value in; gives it back if the ring is full.
    ///
    /// # Errors
    /// The value, for which there was no room.
    pub fn push(&self, value: T) -> Result<(), T> {
        match self.producer.try_lock() {
            Ok(mut producer) => producer.push(value).map_err(|PushError::Full(value)| value),
            Err(_) => Err(value),
        }
    }

    /// Takes the oldest value out.
    pub fn pop(&self) -> Option<T> {
        self.consumer.try_lock().ok()?.pop().ok()
    }

    /// Whether the taker would find nothing now.
    pub fn is_empty(&self) -> bool {
        self.consumer.try_lock().is_ok_and(|consumer| consumer.is_empty())
    }

    /// How many the taker would find now.
    pub fn waiting(&self) -> usize {
        self.consumer.try_lock().map_or(0, |consumer| consumer.slots())
    }

    /// Whether the giver would find no room now.
    pub fn is_full(&self) -> bool {
        self.producer.try_lock().is_ok_and(|producer| producer.is_full())
    }
}

impl<T: Copy> Ring<T> {
    /// An empty ring whose memory was touched from end to end, so that the first round takes no page faults.
    pub fn touched(capacity: usize, example: T) -> Ring<T> {
        let ring = Ring::new(capacity);
        while ring.push(example).is_ok() {}
        while ring.pop().is_some() {}
        ring
    }
}

impl<T> fmt::Debug for Ring<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Ring")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn order_is_kept_and_a_full_ring_turns_away() {
        let ring = Ring::touched(2, 0);
        assert!(ring.is_empty() && !ring.is_full());
        assert_eq!((ring.push(1), ring.push(2), ring.push(3)), (Ok(()), Ok(()), Err(3)));
        assert!(ring.is_full());
        assert_eq!(ring.waiting(), 2);
        assert_eq!((ring.pop(), ring.pop(), ring.pop()), (Some(1), Some(2), None));
    }

    #[test]
    fn nobody_waits_for_a_thread_that_was_stopped_in_the_middle() {
        let ring = Ring::new(4);
        ring.push(1).unwrap();
        // As if the other thread had been stopped while it holds its end.
        let stopped = ring.producer.lock().unwrap();
        assert_eq!((ring.pop(), ring.pop(), ring.push(2)), (Some(1), None, Err(2)));
        drop(stopped);
        ring.push(3).unwrap();
        let stopped = ring.consumer.lock().unwrap();
        assert_eq!((ring.push(4), ring.pop()), (Ok(()), None));
        drop(stopped);
        assert_eq!((ring.pop(), ring.pop()), (Some(3), Some(4)));
    }

    #[test]
    fn everything_arrives_between_two_threads() {
        const COUNT: u64 = 200_000;
        let ring = Arc::new(Ring::touched(64, 0));
        let giver = std::thread::spawn({
            let ring = Arc::clone(&ring);
            move || {
                for value in 1..=COUNT {
                    while ring.push(value).is_err() {
                        std::thread::yield_now();
                    }
                }
            }
        });
        let mut last = 0;
        while last < COUNT {
            match ring.pop() {
                Some(value) => {
                    assert_eq!(value, last + 1);
                    last = value;
                }
                None => std::thread::yield_now(),
            }
        }
        giver.join().unwrap();
    }
}
