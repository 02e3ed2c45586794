//! Publishes the body dimensions of the suit's wearer.

use equipoise_adapters::clock::now_monotonic_ns;
use equipoise_adapters::suit::BodyCadence;
use equipoise_bus::{Bus, BusError, Publisher};
use equipoise_core::message::SuitBody;

use super::{AdapterError, SUIT_ROLE, exclusive_publisher};

/// Publishes the body dimensions: on change at once, and once a second for late subscribers.
pub(super) struct BodyPublisher {
    publisher: Publisher<SuitBody>,
    cadence: BodyCadence,
}

impl BodyPublisher {
    pub(super) fn new(bus: &Bus) -> Result<BodyPublisher, AdapterError> {
        Ok(BodyPublisher { publisher: exclusive_publisher(bus, SUIT_ROLE)?, cadence: BodyCadence::default() })
    }

    pub(super) fn publish_if_due(&mut self, body: Option<SuitBody>) -> Result<(), BusError> {
        match self.cadence.due(body, now_monotonic_ns()) {
            Some(body) => self.publisher.send(&body).map(drop),
            None => Ok(()),
        }
    }

    pub(super) fn update_connections(&self) -> Result<(), BusError> {
        self.publisher.update_connections()
    }
}
