//! Converts captured network traffic to samples with the assemblers of the live adapters.

use std::collections::VecDeque;

use equipoise_adapters::capture::csv::TIME_BASE_NS;
use equipoise_adapters::capture::{PcapCapture, UdpDatagram};
use equipoise_adapters::counts::Counts;
use equipoise_adapters::ground::{GroundProtocol, GroundRefusal};
use equipoise_adapters::source::OneSender;
use equipoise_adapters::suit::{BodyCadence, SuitAssembler, SuitRefusal};
use equipoise_adapters::wire::ati_rdt::Request;
use equipoise_config::Config;
use equipoise_config::ground::transport::TransportKind;
use equipoise_config::ground::{GroundConfig, GroundSourceKind, ati_rdt};
use equipoise_core::message::GroundSample;

use super::samples::{Sample, SkippedData};

/// Samples of a capture. The first datagram of suit or plate is at [`TIME_BASE_NS`].
pub(super) struct PcapSamples {
    capture: PcapCapture,
    suit: SuitAssembler,
    suit_sender: OneSender,
    body_cadence: BodyCadence,
    ground: Option<Ground>,
    suit_port: u16,
    first_ns: Option<u64>,
    ready: VecDeque<Sample>,
    records: Vec<GroundSample>,
    other_ports: u64,
}

/// A ground device that sends datagrams.
struct Ground {
    protocol: GroundProtocol,
    direction: Direction,
    sender: OneSender,
}

/// Identifies the datagrams of a ground device.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Direction {
    /// The device answers requests from this port.
    From(u16),
    /// The device sends to this port of the host.
    To(u16),
}

impl Direction {
    /// `None` for a ground device that uses serial lines, TCP, or another process.
    fn of(ground: &GroundConfig) -> Option<Direction> {
        let listened = ground.listen.map(|listen| Direction::To(listen.port()));
        let described = ground.address.map(|address| Direction::From(address.port())).or(listened);
        match ground.source {
            GroundSourceKind::AtiRdt => Some(Direction::From(ati_rdt::address(ground).port())),
            GroundSourceKind::MoticonUdp => listened,
            GroundSourceKind::Text
                if ground.text.as_ref().is_some_and(|text| text.transport == TransportKind::Udp) =>
            {
                described
            }
            GroundSourceKind::Binary
                if ground.binary.as_ref().is_some_and(|binary| binary.transport == TransportKind::Udp) =>
            {
                described
            }
            _ => None,
        }
    }
}

impl Ground {
    fn of(config: &GroundConfig) -> anyhow::Result<Option<Ground>> {
        let (Some(direction), Some(device)) = (Direction::of(config), config.device()?) else {
            return Ok(None);
        };
        Ok(Some(Ground {
            protocol: GroundProtocol::new(device, config.settings()),
            direction,
            sender: OneSender::default(),
        }))
    }
}

impl PcapSamples {
    /// Ports, avatar, delays, scale and pose of the plate come from the configuration.
    pub(super) fn new(capture: PcapCapture, config: &Config) -> anyhow::Result<PcapSamples> {
        Ok(PcapSamples {
            capture,
            suit: SuitAssembler::new(config.suit.settings()),
            suit_sender: OneSender::default(),
            body_cadence: BodyCadence::default(),
            ground: Ground::of(&config.ground)?,
            suit_port: config.suit.listen.port(),
            first_ns: None,
            ready: VecDeque::new(),
            records: Vec::new(),
            other_ports: 0,
        })
    }

    fn ingest(&mut self, datagram: &UdpDatagram) {
        let (from, to) = (datagram.source.port(), datagram.destination.port());
        let is_ground = |ground: &Ground| match ground.direction {
            Direction::From(port) => [from, to].contains(&port),
            Direction::To(port) => to == port,
        };
        if !self.ground.as_ref().is_some_and(is_ground) && to != self.suit_port {
            self.other_ports += 1;
            return;
        }
        // Wall-clock time may step back during a capture; times before the first datagram are set to its time.
        let first_ns = *self.first_ns.get_or_insert(datagram.time_ns);
        let arrival_ns = TIME_BASE_NS.saturating_add(datagram.time_ns.saturating_sub(first_ns));
        if to == self.suit_port {
            if !self.suit_sender.admits(datagram.source.ip(), arrival_ns) {
                return self.suit.refuse_datagram(SuitRefusal::ForeignSender);
            }
            let mut sample = self.suit.receive(&datagram.payload, arrival_ns);
            if sample.is_some() {
                self.suit_sender.hold(datagram.source.ip(), arrival_ns);
            }
            while let Some(mut complete) = sample {
                if let Some(body) = self.body_cadence.due(self.suit.body(), arrival_ns) {
                    self.ready.push_back(Sample::Body(Box::new(body)));
                }
                // Publication time: when the last datagram completes the sample.
                complete.published_ns = arrival_ns;
                self.ready.push_back(Sample::Suit(Box::new(complete)));
                sample = self.suit.take_ready();
            }
        } else if let Some(ground) = &mut self.ground {
            let is_from_device = match ground.direction {
                Direction::From(port) => from == port,
                Direction::To(_) => true,
            };
            if is_from_device && !ground.sender.admits(datagram.source.ip(), arrival_ns) {
                ground.protocol.refuse(GroundRefusal::ForeignSender);
            } else if is_from_device {
                ground.protocol.receive(&datagram.payload, arrival_ns, &mut self.records);
                if !self.records.is_empty() {
                    ground.sender.hold(datagram.source.ip(), arrival_ns);
                }
                for mut record in self.records.drain(..) {
                    record.published_ns = arrival_ns;
                    self.ready.push_back(Sample::Ground(Box::new(record)));
                }
            } else if ground.sender.may_be(datagram.destination.ip())
                && Request::parse(&datagram.payload).is_ok()
            {
                // A new request starts a new stream, so the next count is its first.
                ground.protocol.opened(arrival_ns);
            }
        }
    }

    /// Wall-clock time of the capturing computer at [`TIME_BASE_NS`], ns since 1970; available after the first
    /// datagram.
    pub(super) fn wall_clock_ns(&self) -> Option<u64> {
        self.first_ns
    }

    pub(super) fn skipped(&self) -> SkippedData {
        let mut skipped = SkippedData::default();
        for (reason, tally) in self.capture.rejected().reasons() {
            let note = format!("{} packets {reason} (first at packet {})", tally.count, tally.first);
            // Every capture contains ARP, TCP and the like; do not report them as rejected.
            match reason {
                "not_ip" | "not_udp" => skipped.ignored.push(note),
                _ => skipped.rejected.push(note),
            }
        }
        if self.other_ports > 0 {
            let suit = format!("{} (suit.listen)", self.suit_port);
            let which = match self.ground.as_ref().map(|ground| ground.direction) {
                Some(Direction::From(port)) => format!("neither port {suit} nor {port} (ground.address)"),
                Some(Direction::To(port)) => format!("neither port {suit} nor {port} (ground.listen)"),
                None => format!(
                    "another port than {suit}; the ground that is configured does not come as datagrams"
                ),
            };
            let note = format!("{} datagrams of {which}", self.other_ports);
            skipped.ignored.push(note);
        }
        add_refused("suit datagrams", self.suit.counts(), SuitRefusal::NAMES, &mut skipped);
        if let Some(ground) = &self.ground {
            add_refused("ground records", ground.protocol.counts(), GroundRefusal::NAMES, &mut skipped);
        }
        skipped.rejected.extend(self.capture.fault().map(ToString::to_string));
        skipped
    }
}

fn add_refused(what: &str, counts: &Counts, names: &[&str], skipped: &mut SkippedData) {
    for (name, count) in names.iter().zip(counts.refused).filter(|(_, count)| *count > 0) {
        let note = format!("{count} {what} {name}");
        // Another character on the same port belongs to another subject.
        if *name == SuitRefusal::OtherAvatar.name() {
            skipped.ignored.push(note);
        } else {
            skipped.rejected.push(note);
        }
    }
    if counts.lost > 0 {
        skipped.ignored.push(format!("{} {what} missing by the device's counter", counts.lost));
    }
}

impl Iterator for PcapSamples {
    type Item = Sample;

    fn next(&mut self) -> Option<Sample> {
        loop {
            if let Some(sample) = self.ready.pop_front() {
                return Some(sample);
            }
            let datagram = self.capture.next()?;
            self.ingest(&datagram);
        }
    }
}
