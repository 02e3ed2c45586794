//! An outlet of the Lab Streaming Layer with a plate's six channels.

use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};

use super::line::Line;
use super::load::{LoadSample, Mounting};
use super::tcp::TcpPort;
use super::{Connected, HostRequests, Protocol};
use crate::wires::lsl::{
    self, DISCOVERY_PORT, Info, Question, Request, SERVICE_PORTS, feed_header, question, short_info,
    take_request, time_data,
};

/// Assignment of the channels.
const CHANNELS: &str = "fx = \"Fx\"\nfy = \"Fy\"\nfz = \"Fz\"\nmx = \"Mx\"\nmy = \"My\"\nmz = \"Mz\"\n";
/// The outlet's clock at device time zero, s: it counts since the computer's start.
const CLOCK_S: f64 = 5000.0;
/// Multicast groups for discovery on one machine and in one network.
const GROUPS: [Ipv4Addr; 2] = [Ipv4Addr::new(224, 0, 0, 183), Ipv4Addr::new(239, 255, 172, 215)];

/// The outlet.
pub struct Lsl {
    info: Info,
    mounting: Mounting,
    service_address: SocketAddr,
    discoverable: bool,
    service: Option<UdpSocket>,
    discovery: Option<UdpSocket>,
    feeding: bool,
}

impl Lsl {
    /// An outlet with a name, whose samples come from an address (port 0: any free one). A discoverable one is found by
    /// its name; the port of its other services is then one of the discovery range, if one is free.
    ///
    /// # Errors
    /// Those of the sockets.
    pub fn bind(
        name: &str,
        address: SocketAddr,
        mounting: Mounting,
        rate_hz: f64,
        discoverable: bool,
        seed: u64,
    ) -> io::Result<Connected<Lsl>> {
        let ports = if discoverable { SERVICE_PORTS } else { 0..1 };
        let service = ports
            .map(|port| UdpSocket::bind(SocketAddr::new(address.ip(), port)))
            .find(Result::is_ok)
            .unwrap_or_else(|| UdpSocket::bind(SocketAddr::new(address.ip(), 0)))?;
        service.set_nonblocking(true)?;
        let service_address = service.local_addr()?;
        let feed = TcpPort::bind(address)?;
        let names = [("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Mx", "Nm"), ("My", "Nm"), ("Mz", "Nm")];
        let info = Info {
            name: name.into(),
            kind: "Force".into(),
            channels: names.map(|(label, unit)| (label.into(), unit.into())).into(),
            rate_hz,
            uid: format!("b0f2c9a4-0000-4000-8000-{seed:012x}"),
            ports: [feed.address().port(), service_address.port()],
        };
        let outlet = Lsl {
            info,
            mounting,
            service_address,
            discoverable,
            service: Some(service),
            // Another outlet of this computer may hold the port exclusively.
            discovery: if discoverable { discovery().ok() } else { None },
            feeding: false,
        };
        Ok(Connected::new(outlet, Line::new(Box::new(feed), seed)))
    }

    fn answer_questions(&mut self, now_s: f64) -> io::Result<()> {
        for socket in [&self.service, &self.discovery].into_iter().flatten() {
            let mut bytes = [0; 2048];
            loop {
                let (length, from) = match socket.recv_from(&mut bytes) {
                    Ok(received) => received,
                    Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                    // The peer no longer waits for an answer.
                    Err(_) => break,
                };
                let (answer, to) = match question(&bytes[..length]) {
                    Some(Question::ShortInfo { query, port, id }) if self.info.matches(&query) => {
                        (short_info(&id, &self.info), SocketAddr::new(from.ip(), port))
                    }
                    Some(Question::Time { wave, sent_s }) => {
                        (time_data(wave, sent_s, CLOCK_S + now_s, CLOCK_S + now_s), from)
                    }
                    _ => continue,
                };
                let _ = socket.send_to(&answer, to);
            }
        }
        Ok(())
    }
}

/// The discovery port, shared with every other outlet of this computer.
fn discovery() -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, DISCOVERY_PORT))?;
    socket.set_nonblocking(true)?;
    for group in GROUPS {
        // Without a network, joining a group fails; unicast queries are still answered.
        let _ = socket.join_multicast_v4(&group, &Ipv4Addr::LOCALHOST);
        let _ = socket.join_multicast_v4(&group, &Ipv4Addr::UNSPECIFIED);
    }
    Ok(socket)
}

impl Protocol for Lsl {
    fn greet(&mut self, _feed: &mut Line) -> io::Result<()> {
        self.feeding = false;
        Ok(())
    }

    fn receive(
        &mut self,
        feed: &mut Line,
        received: &mut Vec<u8>,
        device_now_s: f64,
    ) -> io::Result<HostRequests> {
        self.answer_questions(device_now_s)?;
        while let Some(request) = take_request(received) {
            match request {
                Request::FullInfo => feed.answer(self.info.to_xml(true).as_bytes())?,
                Request::ShortInfo(query) if self.info.matches(&query) => {
                    feed.answer(self.info.to_xml(false).as_bytes())?;
                }
                Request::Feed { uid, .. } if uid.is_empty() || uid == self.info.uid => {
                    feed.answer(&feed_header(&self.info))?;
                    self.feeding = true;
                    continue;
                }
                Request::Feed { .. } => feed.answer(b"LSL/110 404 Not found")?,
                Request::ShortInfo(_) | Request::Unknown => {}
            }
            // All responses except the feed are sent once, and the connection is closed.
            feed.port().hang_up();
        }
        Ok(HostRequests::default())
    }

    fn rate_hz(&self) -> f64 {
        self.info.rate_hz
    }

    fn measure(&mut self, feed: &mut Line, sample: &LoadSample) -> io::Result<()> {
        let Some(wrench) = sample.plates.first().filter(|_| self.feeding) else { return Ok(()) };
        let values = wrench.components().map(|number| number as f32);
        feed.send(&lsl::sample(CLOCK_S + sample.device_s, &values), 1)
    }

    fn power(&mut self, _feed: &mut Line, on: bool) -> io::Result<()> {
        self.feeding = false;
        if !on {
            self.service = None;
        } else if self.service.is_none() {
            let service = UdpSocket::bind(self.service_address)?;
            service.set_nonblocking(true)?;
            self.service = Some(service);
        }
        Ok(())
    }

    fn config(&self, feed: &Line) -> String {
        // A discoverable outlet needs no address.
        let keys = if self.discoverable { <[String; 2]>::default() } else { feed.config() };
        let ground = self.mounting.config("lsl", keys);
        format!("{ground}[ground.lsl]\nname = {:?}\n\n[ground.lsl.channels]\n{CHANNELS}", self.info.name)
    }
}
