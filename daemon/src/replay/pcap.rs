//! Captured network traffic to samples, by the same assemblers that listen on the wires.

use std::collections::VecDeque;
use std::path::Path;

use equipoise_adapters::capture::csv::TIME_BASE_NS;
use equipoise_adapters::capture::{PcapCapture, PcapError, UdpDatagram};
use equipoise_adapters::counts::Counts;
use equipoise_adapters::ground::{RdtReceiver, RdtRefusal};
use equipoise_adapters::suit::{SuitAssembler, SuitRefusal};
use equipoise_adapters::wire::ati_rdt::Request;
use equipoise_core::message::GroundSample;

use super::samples::{LeftOut, Sample};
use crate::config::Config;
use crate::sensors::{rdt_settings, suit_settings};

/// Samples made of a capture. The first datagram of suit or plate is at [`TIME_BASE_NS`].
pub(super) struct PcapSamples {
    capture: PcapCapture,
    suit: SuitAssembler,
    ground: RdtReceiver,
    suit_port: u16,
    ground_port: u16,
    first_ns: Option<u64>,
    ready: VecDeque<Sample>,
    records: Vec<GroundSample>,
    other_ports: u64,
}

impl PcapSamples {
    /// Opens a capture; ports, avatar, delays, scale and place of the plate are the configuration's.
    pub(super) fn open(path: &Path, config: &Config) -> Result<PcapSamples, PcapError> {
        Ok(PcapSamples {
            capture: PcapCapture::open(path)?,
            suit: SuitAssembler::new(suit_settings(&config.suit)),
            ground: RdtReceiver::new(rdt_settings(&config.ground)),
            suit_port: config.suit.listen.port(),
            ground_port: config.ground.address.port(),
            first_ns: None,
            ready: VecDeque::new(),
            records: Vec::new(),
            other_ports: 0,
        })
    }

    fn take(&mut self, datagram: &UdpDatagram) {
        let (from, to) = (datagram.source.port(), datagram.destination.port());
        if ![from, to].contains(&self.ground_port) && to != self.suit_port {
            self.other_ports += 1;
            return;
        }
        // Wall-clock time, which may have been stepped back while capturing; the first instant is then held.
        let first_ns = *self.first_ns.get_or_insert(datagram.time_ns);
        let arrival_ns = TIME_BASE_NS.saturating_add(datagram.time_ns.saturating_sub(first_ns));
        if to == self.suit_port {
            let mut sample = self.suit.receive(&datagram.payload, arrival_ns);
            while let Some(mut complete) = sample {
                // It is whole only now, whenever its first datagram came.
                complete.published_ns = arrival_ns;
                self.ready.push_back(Sample::Suit(Box::new(complete)));
                sample = self.suit.take_ready();
            }
        } else if from == self.ground_port {
            self.ground.receive(&datagram.payload, arrival_ns, &mut self.records);
            for mut record in self.records.drain(..) {
                record.published_ns = arrival_ns;
                self.ready.push_back(Sample::Ground(Box::new(record)));
            }
        } else if Request::parse(&datagram.payload).is_ok() {
            // Whatever the plate counts next is the first of a new stream.
            self.ground.stream_restarted();
        }
    }

    pub(super) fn left_out(&self) -> LeftOut {
        let mut left_out = LeftOut::default();
        for (reason, tally) in self.capture.rejected().reasons() {
            let told = format!("{} packets {reason} (first at packet {})", tally.count, tally.first);
            // ARP, TCP and the like are part of every capture.
            match reason {
                "not_ip" | "not_udp" => left_out.passed_over.push(told),
                _ => left_out.rejected.push(told),
            }
        }
        if self.other_ports > 0 {
            let ports = format!("{} (suit.listen) nor {} (ground.address)", self.suit_port, self.ground_port);
            left_out.passed_over.push(format!("{} datagrams of neither port {ports}", self.other_ports));
        }
        tell_refused("suit datagrams", self.suit.counts(), SuitRefusal::NAMES, &mut left_out);
        tell_refused("ground records", self.ground.counts(), RdtRefusal::NAMES, &mut left_out);
        left_out.rejected.extend(self.capture.fault().map(ToString::to_string));
        left_out
    }
}

fn tell_refused(what: &str, counts: &Counts, names: &[&str], left_out: &mut LeftOut) {
    for (name, count) in names.iter().zip(counts.refused).filter(|(_, count)| *count > 0) {
        let told = format!("{count} {what} {name}");
        // Another character on the same port is another worker.
        if *name == SuitRefusal::OtherAvatar.name() {
            left_out.passed_over.push(told);
        } else {
            left_out.rejected.push(told);
        }
    }
    if counts.lost > 0 {
        left_out.passed_over.push(format!("{} {what} missing by the device's counter", counts.lost));
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
            self.take(&datagram);
        }
    }
}
