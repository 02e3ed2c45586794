//! Publishing a topic.

use crate::error::BusError;
use crate::node::Bus;
use crate::open::{PortLimit, create_port, open_or_create};
use crate::service::{BORROWED_MAX, NODES_MAX, Topic};
use iceoryx2::port::publisher::{Publisher as IceoryxPublisher, PublisherCreateError};
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::{BackpressureStrategy, MessagingPattern, PortFactory as _, ipc};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use std::any::Any;
use std::fmt;
use std::marker::PhantomData;

pub(crate) type Factory<M> = PortFactory<ipc::Service, M, ()>;

/// Opens the topic's service with the settings of its row in the table.
pub(crate) fn open_topic<M: Topic>(bus: &Bus) -> Result<(String, Factory<M>), BusError> {
    let row = M::SERVICE;
    let name = row.name(&bus.station);
    let schema = format!("0x{:016x}", M::schema());
    let factory =
        open_or_create(bus, &name, MessagingPattern::PublishSubscribe, &schema, |name, attributes| {
            bus.node
                .service_builder(name)
                .publish_subscribe::<M>()
                .enable_safe_overflow(true)
                .history_size(row.history)
                .subscriber_max_buffer_size(row.depth_max)
                .subscriber_max_borrowed_samples(BORROWED_MAX)
                .max_publishers(row.publishers_max())
                .max_subscribers(row.subscribers_max)
                .max_nodes(NODES_MAX)
                .open_or_create_with_attributes(attributes)
        })?;
    Ok((name, factory))
}

/// Port of a publisher without the generic types of iceoryx2, which every crate that holds a publisher would otherwise
/// compile again; see [`Topic::open_publisher`].
trait PublisherPort<M> {
    fn send(&self, message: &M) -> Result<usize, BusError>;
    fn update_connections(&self) -> Result<(), BusError>;
    fn subscriber_count(&self) -> usize;
    fn publisher_count(&self) -> usize;
}

struct IceoryxPort<M: Topic> {
    port: IceoryxPublisher<ipc::Service, M, ()>,
    factory: Factory<M>,
    name: String,
}

impl<M: Topic> PublisherPort<M> for IceoryxPort<M> {
    fn send(&self, message: &M) -> Result<usize, BusError> {
        let sample = self.port.loan_uninit().map_err(BusError::failed("send", &self.name))?;
        sample.write_payload(*message).send().map_err(BusError::failed("send", &self.name))
    }

    fn update_connections(&self) -> Result<(), BusError> {
        self.port.update_connections().map_err(BusError::failed("update the subscribers", &self.name))
    }

    fn subscriber_count(&self) -> usize {
        self.factory.dynamic_config().number_of_subscribers()
    }

    fn publisher_count(&self) -> usize {
        self.factory.dynamic_config().number_of_publishers()
    }
}

/// Publishes messages of one type. Readers never block it.
pub struct Publisher<M: Topic> {
    port: Box<dyn PublisherPort<M>>,
    name: String,
}

impl<M: Topic> fmt::Debug for Publisher<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Publisher({})", self.name)
    }
}

impl<M: Topic> Publisher<M> {
    pub(crate) fn open(bus: &Bus) -> Result<Publisher<M>, BusError> {
        let (name, factory) = open_topic::<M>(bus)?;
        let limit = PortLimit { what: "publisher", most: M::SERVICE.publishers_max() };
        let port =
            create_port(bus, &name, limit, PublisherCreateError::ExceedsMaxSupportedPublishers, || {
                factory
                    .publisher_builder()
                    .max_loaned_samples(1)
                    .backpressure_strategy(BackpressureStrategy::DiscardData)
                    .create()
            })?;
        Ok(Publisher { port: Box::new(IceoryxPort { port, factory, name: name.clone() }), name })
    }

    /// Copies one message into shared memory for every subscriber; returns their number.
    ///
    /// A subscriber whose buffer is full loses its oldest message. Allocates once (48 bytes); more if a subscriber
    /// connected or disconnected since the last call.
    ///
    /// # Errors
    /// No shared memory is available, or a subscriber's connection is damaged; the other subscribers have the message.
    pub fn send(&self, message: &M) -> Result<usize, BusError> {
        self.port.send(message)
    }

    /// Delivers the history to subscribers that connected since the last [`Publisher::send`], and releases the memory
    /// and descriptors of those that disconnected.
    ///
    /// Sending does the same; this call is for a topic with long pauses.
    ///
    /// # Errors
    /// The connection to a subscriber cannot be established.
    pub fn update_connections(&self) -> Result<(), BusError> {
        self.port.update_connections()
    }

    /// Number of subscribers; a killed one counts until it is cleaned up.
    pub fn subscriber_count(&self) -> usize {
        self.port.subscriber_count()
    }

    /// Number of publishers, this one included.
    pub fn publisher_count(&self) -> usize {
        self.port.publisher_count()
    }
}

/// A topic's service, held open.
pub struct RetainedService<M: Topic> {
    _factory: Box<dyn Any>,
    name: String,
    message: PhantomData<M>,
}

impl<M: Topic> fmt::Debug for RetainedService<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RetainedService({})", self.name)
    }
}

impl<M: Topic> RetainedService<M> {
    pub(crate) fn open(bus: &Bus) -> Result<RetainedService<M>, BusError> {
        let (name, factory) = open_topic::<M>(bus)?;
        Ok(RetainedService { _factory: Box::new(factory), name, message: PhantomData })
    }
}
