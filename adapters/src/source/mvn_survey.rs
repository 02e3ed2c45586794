//! Survey of MVN's data on the port, without publishing samples.

use super::error::SourceError;
use super::mvn::{MvnSettings, MvnTransport};
use super::tcp_socket::{SocketEvent, TcpSocket};
use super::udp::StampedUdpSocket;
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
            let mut socket =
                StampedUdpSocket::open(settings.listen, settings.senders(), settings.timeout, KEY)?;
            while goes_on() {
                match socket.receive()? {
                    Some(received) if received.admitted => {
                        survey.take(received.sender.ip(), received.bytes, received.arrival_ns);
                    }
                    Some(received) => survey.turn_away(received.sender.ip()),
                    None => {}
                }
            }
        }
        MvnTransport::Tcp => {
            let mut socket = TcpSocket::open(settings.listen, settings.senders(), settings.timeout, KEY)?;
            while goes_on() {
                match socket.receive()? {
                    Some(SocketEvent::Datagram { bytes, sender, arrival_ns }) => {
                        survey.take(sender.ip(), bytes, arrival_ns);
                        // No samples are assembled here: any sender of valid datagrams counts as the suit.
                        socket.accepted();
                    }
                    Some(SocketEvent::LostStep) => survey.lose_step(),
                    Some(SocketEvent::Refused(sender)) => survey.turn_away(sender.ip()),
                    None => {}
                }
            }
        }
    }
    Ok(survey)
}
