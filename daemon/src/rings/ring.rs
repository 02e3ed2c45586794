//! A ring between two threads that never wait for each other.
//!
//! Queues for many threads let one thread wait for another that was interrupted in the middle of a push or pop. The
//! loop has the highest priority and would wait forever for a thread that it has displaced from the core. With one
//! thread at each end there is no such wait.

use std::fmt;
use std::sync::Mutex;

use rtrb::{Consumer, Producer, PushError, RingBuffer};

/// A ring of fixed size with one thread at each end; allocates only when created.
///
/// The lock of each end only satisfies the compiler: it is tried, never waited for. If two threads use the same end at
/// once, the ring may appear full or empty.
pub struct Ring<T> {
    producer: Mutex<Producer<T>>,
    consumer: Mutex<Consumer<T>>,
}

impl<T> Ring<T> {
    /// Creates an empty ring.
    pub fn new(capacity: usize) -> Ring<T> {
        let (producer, consumer) = RingBuffer::new(capacity);
        Ring { producer: Mutex::new(producer), consumer: Mutex::new(consumer) }
    }

    /// Appends a value; returns it if the ring is full.
    ///
    /// # Errors
    /// The rejected value.
    pub fn push(&self, value: T) -> Result<(), T> {
        match self.producer.try_lock() {
            Ok(mut producer) => producer.push(value).map_err(|PushError::Full(value)| value),
            Err(_) => Err(value),
        }
    }

    /// Removes the oldest value.
    pub fn pop(&self) -> Option<T> {
        self.consumer.try_lock().ok()?.pop().ok()
    }

    /// Whether the ring appears empty to the consumer.
    pub fn is_empty(&self) -> bool {
        self.consumer.try_lock().is_ok_and(|consumer| consumer.is_empty())
    }

    /// Number of values available to the consumer.
    pub fn len(&self) -> usize {
        self.consumer.try_lock().map_or(0, |consumer| consumer.slots())
    }

    /// Whether the ring appears full to the producer.
    pub fn is_full(&self) -> bool {
        self.producer.try_lock().is_ok_and(|producer| producer.is_full())
    }
}

impl<T: Copy> Ring<T> {
    /// An empty ring whose memory was touched completely, so that its first use causes no page faults.
    pub fn prefaulted(capacity: usize, example: T) -> Ring<T> {
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
    fn order_is_preserved_and_a_full_ring_rejects_values() {
        let ring = Ring::prefaulted(2, 0);
        assert!(ring.is_empty() && !ring.is_full());
        assert_eq!((ring.push(1), ring.push(2), ring.push(3)), (Ok(()), Ok(()), Err(3)));
        assert!(ring.is_full());
        assert_eq!(ring.len(), 2);
        assert_eq!((ring.pop(), ring.pop(), ring.pop()), (Some(1), Some(2), None));
    }

    #[test]
    fn a_preempted_thread_blocks_no_other() {
        let ring = Ring::new(4);
        ring.push(1).unwrap();
        // Simulates that the other thread was interrupted while it holds its end.
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
        let ring = Arc::new(Ring::prefaulted(64, 0));
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
