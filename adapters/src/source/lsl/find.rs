//! Discovery of a stream.

use super::LslLineSettings;
use crate::clock::now_monotonic_ns;
use crate::source::error::SourceError;
use crate::wire::lsl::{
    DISCOVERY_PORT, FIRST_SERVICE_PORT, MULTICAST, SERVICE_PORTS, StreamInfo, short_info_answer,
    short_info_request,
};
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// All outlets of a network answer within this; the request is sent twice, as datagrams may be lost.
const ROUND: Duration = Duration::from_millis(400);
const ROUNDS: u32 = 2;
/// TTL of the request: routers do not forward it.
const HOPS: u32 = 1;

/// Targets of the request: the ports of outlets on this computer and, if configured, the whole network.
pub(super) fn targets(whole_network: bool) -> Vec<SocketAddr> {
    let service = FIRST_SERVICE_PORT..FIRST_SERVICE_PORT + SERVICE_PORTS;
    let own = [DISCOVERY_PORT].into_iter().chain(service);
    let mut targets: Vec<SocketAddr> =
        own.map(|port| SocketAddr::from((Ipv4Addr::LOCALHOST, port))).collect();
    if whole_network {
        let groups = MULTICAST.map(Ipv4Addr::from).into_iter().chain([Ipv4Addr::BROADCAST]);
        targets.extend(groups.map(|group| SocketAddr::from((group, DISCOVERY_PORT))));
    }
    targets
}

/// The address of the one stream with the requested properties.
pub(super) fn stream(settings: &LslLineSettings, targets: &[SocketAddr]) -> Result<SocketAddr, SourceError> {
    let what = || format!("a stream {}", settings.in_words());
    let absent = |error| {
        SourceError::Absent {
        what: what(),
        remedy: if settings.whole_network {
            "is its program running on this network, and are name, type and source_id in [ground.lsl] as it has them?"
        } else {
            "is its program running on this computer? (for one on another: ground.address, or ground.allow_remote = true)"
        }
        .to_owned(),
        error,
    }
    };
    let found = ask_around(settings, targets).map_err(absent)?;
    match &found[..] {
        [] => Err(absent(io::Error::new(io::ErrorKind::NotFound, "no answer"))),
        [(address, _)] => Ok(*address),
        several => {
            let each = several.iter().map(|(address, info)| format!("{:?} at {address}", info.source_id));
            Err(SourceError::Unready {
                what: what(),
                why: format!("there are {}: {}", several.len(), each.collect::<Vec<_>>().join(", ")),
                remedy: "say which with ground.lsl.source_id, or with ground.address".to_owned(),
            })
        }
    }
}

/// All streams that answer, each once.
fn ask_around(
    settings: &LslLineSettings,
    targets: &[SocketAddr],
) -> io::Result<Vec<(SocketAddr, StreamInfo)>> {
    // On loopback, only this computer can answer.
    let ip = if settings.whole_network { Ipv4Addr::UNSPECIFIED } else { Ipv4Addr::LOCALHOST };
    let socket = UdpSocket::bind((ip, 0))?;
    if settings.whole_network {
        socket.set_broadcast(true)?;
        socket.set_multicast_ttl_v4(HOPS)?;
    }
    // Distinguishes answers to this request from those to an earlier one.
    let id = (now_monotonic_ns() / 1000) as u32 & 0x3fff_ffff;
    let question = short_info_request(&settings.properties(), socket.local_addr()?.port(), id);
    let mut found: Vec<(SocketAddr, StreamInfo)> = Vec::new();
    let mut buffer = vec![0; 65_536];
    for _ in 0..ROUNDS {
        for target in targets {
            // An unreachable target must not prevent the others.
            let _unreachable = socket.send_to(&question, target);
        }
        let until = Instant::now() + ROUND;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            socket.set_read_timeout(Some(left))?;
            // Errors are the ICMP replies of ports without a listener.
            let Ok((length, sender)) = socket.recv_from(&mut buffer) else { continue };
            let answer = buffer.get(..length).unwrap_or_default();
            let Some(info) = short_info_answer(answer, id) else { continue };
            let known = found.iter().any(|(_, other)| other.uid == info.uid);
            if settings.matches(&info) && info.data_port != 0 && !known {
                found.push((SocketAddr::new(sender.ip(), info.data_port), info));
            }
        }
    }
    Ok(found)
}
