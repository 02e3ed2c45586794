//! Subscribing to a topic.

use crate::error::BusError;
use crate::node::Bus;
use crate::open::{PortLimit, create_port};
use crate::publisher::{Factory, open_topic};
use crate::service::Topic;
use iceoryx2::port::subscriber::{Subscriber as IceoryxSubscriber, SubscriberCreateError};
use iceoryx2::prelude::{PortFactory as _, ipc};
use iceoryx2::sample::Sample;
use std::fmt;

/// Port of a subscriber without the generic types of iceoryx2, which every crate that holds a subscriber would otherwise
/// compile again; see [`Topic::open_publisher`].
trait SubscriberPort<M> {
    /// Passes the oldest unread message to `read`, if there is one.
    fn receive(&mut self, read: &mut dyn FnMut(&M)) -> Result<(), BusError>;
    fn latest(&mut self) -> Result<Option<M>, BusError>;
    fn writer(&self) -> u128;
    fn publisher_count(&self) -> usize;
}

struct IceoryxPort<M: Topic> {
    port: IceoryxSubscriber<ipc::Service, M, ()>,
    factory: Factory<M>,
    name: String,
    depth: usize,
    writer: u128,
}

impl<M: Topic> IceoryxPort<M> {
    fn next(&mut self) -> Result<Option<Sample<ipc::Service, M, ()>>, BusError> {
        let sample = self.port.receive().map_err(BusError::failed("receive", &self.name))?;
        if let Some(sample) = &sample {
            self.writer = sample.header().publisher_id().value();
        }
        Ok(sample)
    }
}

impl<M: Topic> SubscriberPort<M> for IceoryxPort<M> {
    fn receive(&mut self, read: &mut dyn FnMut(&M)) -> Result<(), BusError> {
        if let Some(sample) = self.next()? {
            read(sample.payload());
        }
        Ok(())
    }

    fn latest(&mut self) -> Result<Option<M>, BusError> {
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

    fn writer(&self) -> u128 {
        self.writer
    }

    fn publisher_count(&self) -> usize {
        self.factory.dynamic_config().number_of_publishers()
    }
}

/// Reads messages of one type, oldest first. Reconnects to a restarted publisher by itself.
pub struct Subscriber<M: Topic> {
    port: Box<dyn SubscriberPort<M>>,
    name: String,
    depth: usize,
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
        let limit = PortLimit { what: "subscriber", most: row.subscribers_max };
        let port =
            create_port(bus, &name, limit, SubscriberCreateError::ExceedsMaxSupportedSubscribers, || {
                factory.subscriber_builder().buffer_size(depth).history_request(row.history).create()
            })?;
        let port = Box::new(IceoryxPort { port, factory, name: name.clone(), depth, writer: 0 });
        Ok(Subscriber { port, name, depth })
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
        let (mut read, mut result) = (Some(read), None);
        self.port.receive(&mut |message| result = read.take().map(|read| read(message)))?;
        Ok(result)
    }

    /// The newest unread message; older ones are dropped.
    ///
    /// # Errors
    /// The connection to a publisher is damaged.
    pub fn latest(&mut self) -> Result<Option<M>, BusError> {
        self.port.latest()
    }

    /// Id of the publisher of the last message received; a restarted publisher has another id. 0 before the first
    /// message.
    pub fn writer(&self) -> u128 {
        self.port.writer()
    }

    /// Number of publishers; a killed one counts until it is cleaned up.
    pub fn publisher_count(&self) -> usize {
        self.port.publisher_count()
    }
}
