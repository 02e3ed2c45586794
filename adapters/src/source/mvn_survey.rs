//! Survey of MVN's data on the port, without publishing samples.

use super::error::SourceError;
use super::mvn::{MvnSettings, MvnTransport};
use super::tcp_door::{Heard, TcpDoor};
use super::udp::UdpDoor;
use crate::suit::Survey;
use std::time::{Duration, Instant};

/// The configuration key of the address.
const KEY: &str = "suit.listen";

/// Listens for `time`, or until `stopping` returns `true`, and returns the survey. `settings.others` is ignored.
///
/// # Errors
/// [`SourceError::PortTaken`] or [`SourceError::Open`]; [`SourceError::Receive`] if the socket itself fails.
pub fn survey(
    settings: &MvnSettings,
    time: Duration,
    stopping: &dyn Fn() -> bool,
) -> Result<Survey, SourceError> {
    let mut survey = Survey::new(settings.suit);
    let begun = Instant::now();
    let goes_on = || begun.elapsed() < time && !stopping();
    match settings.transport {
        MvnTransport::Udp => {
            let mut door = UdpDoor::open(settings.listen, settings.senders(), settings.timeout, KEY)?;
            while goes_on() {
                match door.receive()? {
                    Some(received) if received.admitted => {
                        survey.take(received.sender.ip(), received.bytes, received.arrival_ns);
                    }
                    Some(received) => survey.turn_away(received.sender.ip()),
                    None => {}
                }
            }
        }
        MvnTransport::Tcp => {
            let mut door = TcpDoor::open(settings.listen, settings.senders(), settings.timeout, KEY)?;
            while goes_on() {
                match door.receive()? {
                    Some(Heard::Datagram { bytes, sender, arrival_ns }) => {
                        survey.take(sender.ip(), bytes, arrival_ns);
                        // No samples are assembled here: any sender of valid datagrams counts as the suit.
                        door.accepted();
                    }
                    Some(Heard::LostStep) => survey.lose_step(),
                    Some(Heard::TurnedAway(sender)) => survey.turn_away(sender.ip()),
                    None => {}
                }
            }
        }
    }
    Ok(survey)
}
