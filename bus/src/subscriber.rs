//! Subscribing to a topic.

use crate::error::BusError;
use crate::node::Bus;
use crate::open::{Place, take};
use crate::publisher::{Factory, open_topic};
use crate::service::Topic;
use iceoryx2::port::subscriber::{Subscriber as Port, SubscriberCreateError};
use iceoryx2::prelude::{PortFactory as _, ipc};
use iceoryx2::sample::Sample;
use std::fmt;

/// Reads messages of one type, oldest first. Reconnects to a restarted publisher by itself.
pub struct Subscriber<M: Topic> {
    port: Port<ipc::Service, M, ()>,
    factory: Factory<M>,
    name: String,
    depth: usize,
    writer: u128,
}

impl<M: Topic> fmt::Debug for Subscriber<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Subscriber({}, depth {})", self.name, self.depth)
    }
}

impl<M: Topic> Subscriber<M> {
    pub(crate) fn open(bus: &Bus, depth: usize) -> Result<Subscriber<M>, BusError> {
        let row = M::SERVICE;
        if depth == 0 || depth > row.depth_max {
            return Err(BusError::Depth {
                service: row.name(&bus.station),
                asked: depth,
                most: row.depth_max,
            });
        }
        let (name, factory) = open_topic::<M>(bus)?;
        let place = Place { what: "subscriber", most: row.subscribers_max };
        let port = take(bus, &name, place, SubscriberCreateError::ExceedsMaxSupportedSubscribers, || {
            factory.subscriber_builder().buffer_size(depth).history_request(row.history).create()
        })?;
        Ok(Subscriber { port, factory, name, depth, writer: 0 })
    }

    /// Copies out the oldest unread message; `None` if there is none.
    ///
    /// # Errors
    /// The connection to a publisher is damaged.
    pub fn receive(&mut self) -> Result<Option<M>, BusError> {
        self.receive_with(|message| *message)
    }

    /// As [`Subscriber::receive`], but `read` accesses the message in place, without a copy.
    ///
    /// # Errors
    /// The connection to a publisher is damaged.
    pub fn receive_with<R>(&mut self, read: impl FnOnce(&M) -> R) -> Result<Option<R>, BusError> {
        Ok(self.next()?.map(|sample| read(sample.payload())))
    }

    /// The newest unread message; older ones are dropped.
    ///
    /// # Errors
    /// The connection to a publisher is damaged.
    pub fn latest(&mut self) -> Result<Option<M>, BusError> {
        let mut newest = self.next()?;
        // Read at most one buffer's worth, so that a fast publisher cannot keep this loop running.
        for _ in 0..self.depth {
            match self.next()? {
                Some(sample) => newest = Some(sample),
                None => break,
            }
        }
        Ok(newest.map(|sample| *sample.payload()))
    }

    /// Id of the publisher of the last message received; a restarted publisher has another id. 0 before the first
    /// message.
    pub fn writer(&self) -> u128 {
        self.writer
    }

    /// Number of publishers; a killed one counts until it is cleaned up.
    pub fn publisher_count(&self) -> usize {
        self.factory.dynamic_config().number_of_publishers()
    }

    fn next(&mut self) -> Result<Option<Sample<ipc::Service, M, ()>>, BusError> {
        let sample = self.port.receive().map_err(BusError::failed("receive", &self.name))?;
        if let Some(sample) = &sample {
            self.writer = sample.header().publisher_id().value();
        }
        Ok(sample)
    }
}
