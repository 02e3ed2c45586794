//! Moves samples from the bus into the loop's rings, so that the loop owns no subscribers.

use std::time::Duration;

use equipoise_bus::{Bus, BusError, BusSettings, Channel, Listener, Subscriber};
use equipoise_config::WaitStrategy;
use equipoise_core::message::{GroundSample, SuitBody, SuitSample};

use crate::realtime::now_ns;
use crate::rings::IngressEnds;

/// Maximum sleep, after which the thread checks for a stop request.
const WAKE_INTERVAL: Duration = Duration::from_millis(50);
/// Depths of the subscribers: a stall of this thread of a quarter of a second loses nothing.
const SUIT_DEPTH: usize = 64;
const GROUND_DEPTH: usize = 256;
const BODY_DEPTH: usize = 4;

/// Ingress with its open ports.
#[derive(Debug)]
pub struct Ingress {
    ends: IngressEnds,
    wait_strategy: WaitStrategy,
    suit: Subscriber<SuitSample>,
    ground: Subscriber<GroundSample>,
    body: Subscriber<SuitBody>,
    listener: Listener,
    // Ports must be dropped before the node that they depend on.
    _bus: Bus,
}

impl Ingress {
    /// Opens the ports.
    ///
    /// # Errors
    /// The bus cannot be joined.
    pub fn open(station: &str, ends: IngressEnds, wait_strategy: WaitStrategy) -> Result<Ingress, BusError> {
        let bus = Bus::join(&BusSettings::new(station, "ingress"))?;
        Ok(Ingress {
            ends,
            wait_strategy,
            suit: bus.subscriber(SUIT_DEPTH)?,
            ground: bus.subscriber(GROUND_DEPTH)?,
            body: bus.subscriber(BODY_DEPTH)?,
            listener: bus.listener(Channel::Inputs)?,
            _bus: bus,
        })
    }

    /// Moves samples from the bus into the rings until stopped.
    ///
    /// # Errors
    /// The bus fails.
    pub fn run(mut self) -> Result<(), BusError> {
        while !self.ends.control.is_stopping() {
            self.wait()?;
            self.forward()?;
        }
        Ok(())
    }

    /// Moves all pending samples; returns their number.
    ///
    /// # Errors
    /// The bus fails.
    pub fn forward(&mut self) -> Result<usize, BusError> {
        let mut forwarded = 0;
        let ends = &mut self.ends;
        let mut ground = |sample: &GroundSample| {
            let now_ns = now_ns();
            match Stamps::of_ground(sample).ahead_ns(now_ns) {
                0 => ends.push_ground(*sample, now_ns),
                ahead_ns => ends.control.refuse_ground(ahead_ns),
            }
        };
        while self.ground.receive_with(&mut ground)?.is_some() {
            forwarded += 1;
        }
        let mut body = |body: &SuitBody| {
            let now_ns = now_ns();
            match Stamps::of_body(body).ahead_ns(now_ns) {
                0 => ends.push_body(*body, now_ns),
                ahead_ns => ends.control.refuse_suit(ahead_ns),
            }
        };
        while self.body.receive_with(&mut body)?.is_some() {
            forwarded += 1;
        }
        let mut suit = |sample: &SuitSample| {
            let now_ns = now_ns();
            match Stamps::of_suit(sample).ahead_ns(now_ns) {
                0 => ends.push_suit(*sample, now_ns),
                ahead_ns => ends.control.refuse_suit(ahead_ns),
            }
        };
        while self.suit.receive_with(&mut suit)?.is_some() {
            forwarded += 1;
        }
        Ok(forwarded)
    }

    /// Sleeps until an event arrives or a short time passes; returns at once when polling.
    ///
    /// # Errors
    /// The bus fails.
    pub fn wait(&self) -> Result<(), BusError> {
        match self.wait_strategy {
            WaitStrategy::Sleeping => self.listener.wait(WAKE_INTERVAL).map(drop),
            WaitStrategy::Polling => {
                std::hint::spin_loop();
                Ok(())
            }
        }
    }
}

/// The stamps of a sample, in the order in which they were taken.
struct Stamps([u64; 3]);

impl Stamps {
    fn of_suit(sample: &SuitSample) -> Stamps {
        Stamps([sample.sample_time_ns, sample.arrival_ns, sample.published_ns])
    }

    fn of_ground(sample: &GroundSample) -> Stamps {
        Stamps([sample.sample_time_ns, sample.arrival_ns, sample.published_ns])
    }

    fn of_body(body: &SuitBody) -> Stamps {
        Stamps([body.arrival_ns, body.arrival_ns, body.published_ns])
    }

    /// How far the latest stamp is in the future. A sample cannot be received before it was sent, so a positive value
    /// means an adapter in another time namespace or with another clock; its samples would be matched with the wrong
    /// ones of the other sensor.
    fn ahead_ns(&self, now_ns: u64) -> u64 {
        self.0.iter().map(|stamp_ns| stamp_ns.saturating_sub(now_ns)).fold(0, u64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_dated_after_its_arrival_is_of_another_clock() {
        let stamps = |shift_ns: u64| Stamps([100, 200, 300].map(|stamp_ns| stamp_ns + shift_ns));
        assert_eq!(stamps(0).ahead_ns(300), 0);
        assert_eq!(stamps(7).ahead_ns(300), 7);
        assert_eq!(Stamps([400, 200, 300]).ahead_ns(350), 50, "dated after it was sent");
    }
}
