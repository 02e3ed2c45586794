//! From the bus to the loop: owns the subscribers, so that the loop need not.

use std::sync::Arc;
use std::time::Duration;

use equipoise_bus::{Bus, BusError, BusSettings, Channel, Listener, Subscriber};
use equipoise_core::message::{GroundSample, SuitSample};

use crate::rings::{Rings, Waiting};

/// Wakes at least this often, to see whether it shall end.
const WAKE_AT_LEAST: Duration = Duration::from_millis(50);
/// Buffers of the subscribers: a stall of this thread of a quarter of a second loses nothing.
const SUIT_DEPTH: usize = 64;
const GROUND_DEPTH: usize = 256;

/// Ingress, with its ports open.
#[derive(Debug)]
pub struct Ingress {
    rings: Arc<Rings>,
    waiting: Waiting,
    suit: Subscriber<SuitSample>,
    ground: Subscriber<GroundSample>,
    listener: Listener,
    // Ports die before the node they hang on.
    _bus: Bus,
}

impl Ingress {
    /// Opens the ports.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn open(station: &str, rings: Arc<Rings>, waiting: Waiting) -> Result<Ingress, BusError> {
        let bus = Bus::join(&BusSettings::new(station, "ingress"))?;
        Ok(Ingress {
            rings,
            waiting,
            suit: bus.subscriber(SUIT_DEPTH)?,
            ground: bus.subscriber(GROUND_DEPTH)?,
            listener: bus.listener(Channel::Inputs)?,
            _bus: bus,
        })
    }

    /// Moves samples from the bus into the rings until it shall stop.
    ///
    /// # Errors
    /// The bus breaks.
    pub fn run(mut self) -> Result<(), BusError> {
        while !self.rings.is_stopping() {
            self.wait()?;
            self.take_in()?;
        }
        Ok(())
    }

    /// Moves what there is now; how many samples.
    ///
    /// # Errors
    /// The bus breaks.
    pub fn take_in(&mut self) -> Result<usize, BusError> {
        let mut taken = 0;
        while self.ground.receive_with(|sample| self.rings.push_ground(*sample))?.is_some() {
            taken += 1;
        }
        while self.suit.receive_with(|sample| self.rings.push_suit(*sample))?.is_some() {
            taken += 1;
        }
        Ok(taken)
    }

    /// Sleeps until somebody says that there is something, at most a moment; not at all if it polls.
    ///
    /// # Errors
    /// The bus breaks.
    pub fn wait(&self) -> Result<(), BusError> {
        match self.waiting {
            Waiting::Sleeping => self.listener.wait(WAKE_AT_LEAST).map(drop),
            Waiting::Polling => {
                std::hint::spin_loop();
                Ok(())
            }
        }
    }
}
