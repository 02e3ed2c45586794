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
            rings.push_ground(sample, now_ns());
        }
        while let Some(sample) = suit.receive()? {
            rings.push_suit(sample, now_ns());
        }
    }
    Ok(())
}
