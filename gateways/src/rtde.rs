//! `[gateways.rtde]`: writes into input registers of a Universal Robots controller; docs/consumers/rtde.md.
//!
//! A register keeps its last value for ever. Therefore the reason why there is no state is written as well, with a
//! sequence number that stops when the gateway stops. A tick never waits for the robot: a thread connects, and packages
//! that the network does not accept are dropped and counted.

mod link;
mod registers;
mod wire;

use anyhow::anyhow;

use crate::config::{Register, RtdeConfig, StationFile};
use crate::gateway::{Gateway, Latest, Tally};
use crate::process::{ScheduledGateway, no_section};
use link::{Connector, Sent, Started};
use registers::{Counts, word};

/// Writes the registers of one controller.
#[derive(Debug)]
pub struct Rtde {
    recipe: Vec<Register>,
    connector: Connector,
    started: Option<Started>,
    counts: Counts,
    sent: u64,
    lost: u64,
}

impl Rtde {
    /// Starts to connect to the configured robot.
    ///
    /// # Errors
    /// The configured registers are invalid; the error states which.
    pub fn new(config: &RtdeConfig) -> anyhow::Result<Rtde> {
        let recipe = config.recipe().map_err(|what| anyhow!("gateways.rtde.registers: {what}"))?;
        let connector = Connector::new(config.robot, recipe.clone());
        Ok(Rtde { recipe, connector, started: None, counts: Counts::default(), sent: 0, lost: 0 })
    }

    fn write(&mut self, latest: &Latest) -> bool {
        if self.started.is_none() {
            self.started = self.connector.poll();
        }
        let Some(started) = &mut self.started else { return false };
        let (counts, recipe) = (self.counts, &self.recipe);
        match started.send(recipe.iter().map(|register| word(register.value, counts, latest))) {
            Ok(Sent::Whole) => {
                self.connector.went_well();
                true
            }
            Ok(Sent::Dropped) => false,
            Err(error) => {
                self.started = None;
                self.connector.lost(&error.to_string());
                false
            }
        }
    }
}

impl Gateway for Rtde {
    fn send(&mut self, latest: &Latest) {
        // 0 is skipped: it means that the register was never written.
        self.counts.sequence = self.counts.sequence.checked_add(1).unwrap_or(1);
        if let Ok(reading) = latest {
            self.counts.daemon_life = reading.daemon_life;
        }
        if self.write(latest) {
            self.sent += 1;
        } else {
            self.lost += 1;
        }
    }

    fn tally(&self) -> Tally {
        Tally { sent: self.sent, lost: self.lost, peers: u64::from(self.started.is_some()) }
    }
}

/// Creates the gateway from the configuration.
///
/// # Errors
/// There is no `[gateways.rtde]`, or its registers are invalid.
pub fn create(file: &StationFile) -> anyhow::Result<ScheduledGateway> {
    let config = file.gateways.rtde.as_ref().ok_or_else(|| no_section("rtde"))?;
    Ok(ScheduledGateway { gateway: Box::new(Rtde::new(config)?), rate_hz: config.rate_hz })
}
