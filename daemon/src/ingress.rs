//! From the bus to the loop: owns the subscribers, so that the loop need not.

use std::sync::Arc;
use std::time::Duration;

use equipoise_bus::{Bus, BusError, BusSettings, Channel};
use equipoise_core::message::{GroundSample, SuitSample};

use crate::realtime::now_ns;
use crate::rings::Rings;

/// Wakes at least this often, to see whether it shall end.
const WAKE_AT_LEAST: Duration = Duration::from_millis(50);
/// Buffers of the subscribers: a stall of this thread of a quarter of a second loses nothing.
const SUIT_DEPTH: usize = 64;
const GROUND_DEPTH: usize = 256;

/// Moves samples from the bus into the rings until it shall stop; `ready` is called once the ports are open.
///
/// # Errors
/// The bus cannot be joined, or breaks.
pub fn run(station: &str, rings: &Arc<Rings>, ready: impl FnOnce()) -> Result<(), BusError> {
    let bus = Bus::join(&BusSettings::new(station, "ingress"))?;
    let mut suit = bus.subscriber::<SuitSample>(SUIT_DEPTH)?;
    let mut ground = bus.subscriber::<GroundSample>(GROUND_DEPTH)?;
    let listener = bus.listener(Channel::Inputs)?;
    ready();
    while !rings.is_stopping() {
        listener.wait(WAKE_AT_LEAST)?;
        while let Some(sample) = ground.receive()? {
            let now_ns = now_ns();
            if Stamps::of_ground(&sample).are_past(now_ns) {
                rings.push_ground(sample, now_ns);
            } else {
                rings.refuse_input();
            }
        }
        while let Some(sample) = suit.receive()? {
            let now_ns = now_ns();
            if Stamps::of_suit(&sample).are_past(now_ns) {
                rings.push_suit(sample, now_ns);
            } else {
                rings.refuse_input();
            }
        }
    }
    Ok(())
}

/// A sample's own stamps, in the order in which they were taken.
struct Stamps([u64; 3]);

impl Stamps {
    fn of_suit(sample: &SuitSample) -> Stamps {
        Stamps([sample.sample_time_ns, sample.arrival_ns, sample.published_ns])
    }

    fn of_ground(sample: &GroundSample) -> Stamps {
        Stamps([sample.sample_time_ns, sample.arrival_ns, sample.published_ns])
    }

    /// Nothing is received before it was sent. An adapter in another time namespace, or on another clock, says
    /// otherwise; its samples would be put beside the wrong ones of the other sensor.
    fn are_past(&self, now_ns: u64) -> bool {
        self.0.iter().all(|stamp_ns| *stamp_ns <= now_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dated_after_its_own_arrival_here_is_of_another_clock() {
        let stamps = |shift_ns: u64| Stamps([100, 200, 300].map(|stamp_ns| stamp_ns + shift_ns));
        assert!(stamps(0).are_past(300));
        assert!(!stamps(1).are_past(300));
        assert!(!Stamps([400, 200, 300]).are_past(350), "dated after it was sent");
    }
}
