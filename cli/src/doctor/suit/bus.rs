//! Examines a suit that a running adapter receives, by the adapter's messages.

use std::time::Duration;

use equipoise_adapters::suit::SuitRefusal;
use equipoise_adapters::wire::mvn::DatagramType;
use equipoise_config::{Config, SuitSourceKind};
use equipoise_core::message::suit::SuitBlocks;

use super::super::Check;
use super::super::suit_facts::BusObservation;
use super::{LOST_FRACTION_MAX, RATE_MIN_HZ, no_data_check, refusals, title};

/// Blocks of a sample that reveal a datagram type.
const BLOCKS: [(SuitBlocks, DatagramType); 4] = [
    (SuitBlocks::LinearKinematics, DatagramType::LINEAR_KINEMATICS),
    (SuitBlocks::AngularKinematics, DatagramType::ANGULAR_KINEMATICS),
    (SuitBlocks::CentreOfMass, DatagramType::CENTRE_OF_MASS),
    (SuitBlocks::JointAngles, DatagramType::JOINT_ANGLES),
];

pub(super) fn evaluate(config: &Config, observation: &BusObservation, time: Duration) -> Vec<Check> {
    let mut checks = vec![samples(config, observation, time)];
    if observation.samples > 0 {
        for (block, kind) in BLOCKS {
            let is_present = observation.blocks & block as u32 != 0;
            checks.push(Check::ok(
                title(kind),
                if is_present { "in the samples" } else { "not in the samples" },
            ));
        }
    }
    if let Some(health) = observation.health {
        let refused = SuitRefusal::NAMES.iter().copied().zip(health.refused);
        checks.extend(refusals(refused, health.received));
    }
    checks.push(Check::skipped(
        "what else is sent",
        "unknown while an adapter has the port: stop it, and run this again",
    ));
    checks
}

fn samples(config: &Config, observation: &BusObservation, time: Duration) -> Check {
    const NAME: &str = "samples";
    let Some(health) = observation.health.filter(|health| health.received > 0 || observation.samples > 0)
    else {
        let fix = match (config.suit.source, observation.health) {
            (SuitSourceKind::External, None) => {
                "start `equipoise adapter suit`, or the daemon that has this station in its suit.forwarded"
                    .to_owned()
            }
            (SuitSourceKind::External, Some(_)) => {
                "look at the adapter's own file with `equipoise doctor suit --config FILE`".to_owned()
            }
            _ => no_data_check(&config.suit),
        };
        return Check::fail(NAME, format!("none on the bus for {} s", time.as_secs_f64()), fix);
    };
    let avatar = observation.avatar.map(|avatar| format!(" of character {avatar}")).unwrap_or_default();
    let found = format!(
        "{:.1} a second{avatar}, by process {}; {} datagrams so far, {} samples lost",
        health.rate_hz, health.process_id, health.received, health.lost
    );
    if observation.samples == 0 {
        return Check::fail(
            NAME,
            format!("{found}; none now"),
            "look at \"refused\", or at MVN: is it paused?",
        );
    }
    if health.lost as f64 > LOST_FRACTION_MAX * (health.published + health.lost) as f64 {
        return Check::warn(NAME, found, "a cable instead of wireless, Protocol TCP, or fewer boxes");
    }
    if health.rate_hz < RATE_MIN_HZ {
        return Check::warn(NAME, found, "raise the Stream rate in the Network Streamer: 60 Hz at the least");
    }
    Check::ok(NAME, found)
}
