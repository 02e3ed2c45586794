//! Waking each other: two event services, one towards the daemon and one from it.

use crate::error::BusError;
use crate::node::Bus;
use crate::open::{PortLimit, create_port, open_or_create};
use crate::service::{LISTENERS_MAX, NODES_MAX, NOTIFIERS_MAX, full_name};
use iceoryx2::port::listener::{Listener as ListenerPort, ListenerCreateError};
use iceoryx2::port::notifier::{Notifier as NotifierPort, NotifierCreateError};
use iceoryx2::prelude::{EventId, MessagingPattern, ipc};
use iceoryx2::service::port_factory::event::PortFactory;
use std::fmt;
use std::time::Duration;

/// The highest event number that a later version may use.
pub const EVENT_NUMBER_MAX: usize = 63;
/// The schema of both event services: what the numbers mean.
pub const EVENTS_SCHEMA: &str = "events/1";

/// Which event service: whom to wake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// `…/wake`: wakes the daemon's ingress, as soon as a sample is published or a command is sent.
    Inputs,
    /// `…/events`: wakes the consumers of results, once per cycle.
    Results,
}

impl Channel {
    /// Both.
    pub const ALL: [Channel; 2] = [Channel::Inputs, Channel::Results];

    /// Last part of the service's name.
    pub const fn suffix(self) -> &'static str {
        match self {
            Channel::Inputs => "wake",
            Channel::Results => "events",
        }
    }

    /// Who notifies.
    pub const fn writer(self) -> &'static str {
        match self {
            Channel::Inputs => "adapters, clients",
            Channel::Results => "daemon",
        }
    }
}

macro_rules! events {
    ($($(#[$doc:meta])* $Name:ident = $number:literal,)*) => {
        /// What happened. The numbers are a contract with other languages and never change.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(u8)]
        pub enum Event {
            $($(#[$doc])* $Name = $number,)*
        }

        impl Event {
            /// All events.
            pub const ALL: &'static [Event] = &[$(Event::$Name),*];
        }
    };
}

events! {
    /// A state was published.
    NewState = 0,
    /// A suit sample was published.
    NewSuit = 1,
    /// A ground sample was published.
    NewGround = 2,
    /// The pipeline entered another phase.
    PhaseChanged = 3,
    /// A cycle missed its deadline.
    DeadlineMissed = 4,
    /// A command waits for the daemon.
    CommandArrived = 5,
    /// A checkpoint was published.
    NewCheckpoint = 6,
    /// An adapter's health was published.
    NewHealth = 7,
    /// A notifier was killed and has been cleaned up; no process sends this one.
    NotifierDied = 8,
    /// What is measured is no longer what the model predicts of this worker; the status says where.
    ModelMismatch = 9,
    /// An incident began or ended: the service `incidents` says which.
    IncidentsChanged = 10,
}

/// The events of one awakening, each however often it came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Events(u64);

impl Events {
    /// Whether `event` is among them.
    pub fn contains(self, event: Event) -> bool {
        self.0 & (1 << event as u8) != 0
    }

    /// Whether nothing happened: the time ran out.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The known ones, lowest number first.
    pub fn iter(self) -> impl Iterator<Item = Event> {
        Event::ALL.iter().copied().filter(move |event| self.contains(*event))
    }

    fn insert(&mut self, number: usize) {
        if number <= EVENT_NUMBER_MAX {
            self.0 |= 1 << number;
        }
    }
}

fn open_channel(bus: &Bus, channel: Channel) -> Result<(String, PortFactory<ipc::Service>), BusError> {
    let name = full_name(&bus.station, channel.suffix());
    let factory = open_or_create(bus, &name, MessagingPattern::Event, EVENTS_SCHEMA, |name, attributes| {
        bus.node
            .service_builder(name)
            .event()
            .event_id_max_value(EVENT_NUMBER_MAX)
            .max_notifiers(NOTIFIERS_MAX)
            .max_listeners(LISTENERS_MAX)
            .max_nodes(NODES_MAX)
            .disable_deadline()
            .disable_notifier_created_event()
            .disable_notifier_dropped_event()
            .notifier_dead_event(EventId::new(Event::NotifierDied as usize))
            .open_or_create_with_attributes(attributes)
    })?;
    Ok((name, factory))
}

/// Wakes the listeners of one channel.
pub struct Notifier {
    port: NotifierPort<ipc::Service>,
    name: String,
}

impl fmt::Debug for Notifier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Notifier({})", self.name)
    }
}

impl Notifier {
    pub(crate) fn open(bus: &Bus, channel: Channel) -> Result<Notifier, BusError> {
        let (name, factory) = open_channel(bus, channel)?;
        let limit = PortLimit { what: "notifier", most: NOTIFIERS_MAX };
        let full = NotifierCreateError::ExceedsMaxSupportedNotifiers;
        let port = create_port(bus, &name, limit, full, || factory.notifier_builder().create())?;
        Ok(Notifier { port, name })
    }

    /// Wakes every listener; how many there were. Never blocks; one system call for each that sleeps.
    ///
    /// # Errors
    /// The service is damaged.
    pub fn notify(&self, event: Event) -> Result<usize, BusError> {
        let id = EventId::new(event as usize);
        self.port.notify_with_custom_event_id(id).map_err(BusError::failed("notify", &self.name))
    }
}

/// Sleeps until a channel is notified.
pub struct Listener {
    port: ListenerPort<ipc::Service>,
    name: String,
}

impl fmt::Debug for Listener {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Listener({})", self.name)
    }
}

impl Listener {
    pub(crate) fn open(bus: &Bus, channel: Channel) -> Result<Listener, BusError> {
        let (name, factory) = open_channel(bus, channel)?;
        let limit = PortLimit { what: "listener", most: LISTENERS_MAX };
        let full = ListenerCreateError::ExceedsMaxSupportedListeners;
        let port = create_port(bus, &name, limit, full, || factory.listener_builder().create())?;
        Ok(Listener { port, name })
    }

    /// Sleeps until something happens or `timeout` has passed; empty when the time ran out or a signal came.
    ///
    /// An event wakes at once. The time-out is coarse: a few milliseconds late at a 250 Hz kernel tick.
    ///
    /// # Errors
    /// The service is damaged.
    pub fn wait(&self, timeout: Duration) -> Result<Events, BusError> {
        use iceoryx2::port::listener::ListenerWaitError::InterruptSignal;
        let mut events = Events::default();
        let collect =
            |activation: iceoryx2::prelude::EventActivation| events.insert(activation.id.as_value());
        let waited = match timeout {
            Duration::ZERO => self.port.try_wait(collect),
            _ => self.port.timed_wait(collect, timeout),
        };
        match waited {
            Ok(_) | Err(InterruptSignal) => Ok(events),
            Err(cause) => Err(BusError::failed("wait", &self.name)(cause)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_event_has_its_own_bit() {
        let mut all = Events::default();
        for event in Event::ALL {
            assert!(!all.contains(*event), "{event:?}");
            all.insert(*event as usize);
        }
        assert_eq!(all.iter().count(), Event::ALL.len());
        all.insert(1000);
    }
}
