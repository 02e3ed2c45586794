//! A force plate that speaks ATI RDT: we ask, it streams.

use super::udp::{Senders, SourceError, UdpDoor};
use crate::clock::now_monotonic_ns;
use crate::counts::{Counts, HealthReporter, Stream};
use crate::ground::{RdtReceiver, RdtRefusal, RdtSettings};
use crate::wire::ati_rdt::{Command, DEFAULT_PORT, Request};
use equipoise_core::message::{AdapterHealth, GroundSample};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;

/// A request may get lost: ask again after this …
const RETRY_NS: u64 = 100_000_000;
/// … so many times, …
const QUICK_RETRIES: u32 = 10;
/// … and then, as the device is probably off, this often.
const SLOW_RETRY_NS: u64 = 1_000_000_000;
/// A stream that is silent for so long has ended: the device was restarted, or another client took it.
const SILENCE_NS: u64 = 500_000_000;

/// Which device, and how to read it.
#[derive(Debug, Clone, Copy)]
pub struct RdtSourceSettings {
    /// The device.
    pub address: SocketAddr,
    /// How to start: [`Command::StartRealTime`] for Net F/T, [`Command::StartSingleBlock`] for Axia.
    pub start: Command,
    /// How long one [`RdtSource::receive`] waits.
    pub timeout: Duration,
    /// Scale, sign and place.
    pub rdt: RdtSettings,
}

impl Default for RdtSourceSettings {
    fn default() -> Self {
        RdtSourceSettings {
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), DEFAULT_PORT),
            start: Command::StartRealTime,
            timeout: Duration::from_millis(50),
            rdt: RdtSettings::default(),
        }
    }
}

/// A plate that streams to us.
#[derive(Debug)]
pub struct RdtSource {
    door: UdpDoor,
    address: SocketAddr,
    start: Command,
    receiver: RdtReceiver,
    health: HealthReporter,
    last_data_ns: u64,
    last_request_ns: u64,
    requests: u32,
}

impl RdtSource {
    /// Opens a socket and asks the device to stream. A device that is off is no error: it is asked again and again.
    ///
    /// # Errors
    /// [`SourceError::Open`] if there is no socket to be had.
    pub fn open(settings: RdtSourceSettings) -> Result<RdtSource, SourceError> {
        let ip = match settings.address.ip() {
            // Bound to loopback if the device is simulated here: nothing else can reach the socket then.
            ip if ip.is_loopback() => ip,
            IpAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            IpAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
        };
        let senders = Senders::Only(settings.address.ip());
        let timeout = settings.timeout.min(Duration::from_nanos(RETRY_NS));
        let mut source = RdtSource {
            door: UdpDoor::open(SocketAddr::new(ip, 0), senders, timeout, "ground.address")?,
            address: settings.address,
            start: settings.start,
            receiver: RdtReceiver::new(settings.rdt),
            health: HealthReporter::new(Stream::Ground, now_monotonic_ns()),
            last_data_ns: 0,
            last_request_ns: 0,
            requests: 0,
        };
        source.request_if_silent(now_monotonic_ns());
        Ok(source)
    }

    /// Waits for one datagram and appends its samples to `samples`; says how many. Zero after the timeout.
    ///
    /// # Errors
    /// [`SourceError::Receive`] if the socket itself fails.
    pub fn receive(&mut self, samples: &mut Vec<GroundSample>) -> Result<usize, SourceError> {
        self.request_if_silent(now_monotonic_ns());
        let before = samples.len();
        let Some(received) = self.door.receive()? else {
            return Ok(0);
        };
        if !received.admitted || received.sender.port() != self.address.port() {
            self.receiver.refuse_datagram(RdtRefusal::ForeignSender);
            return Ok(0);
        }
        self.receiver.receive(received.bytes, received.arrival_ns, samples);
        let count = samples.len() - before;
        if count > 0 {
            self.last_data_ns = received.arrival_ns;
            self.requests = 0;
        }
        Ok(count)
    }

    /// What was counted since the start.
    pub fn counts(&self) -> &Counts {
        self.receiver.counts()
    }

    /// The counts as a message, with the rate since the last call. Reasons in the order of [`RdtRefusal`].
    pub fn health(&mut self) -> AdapterHealth {
        self.health.report(self.receiver.counts(), now_monotonic_ns())
    }

    fn request_if_silent(&mut self, now_ns: u64) {
        let pause_ns = if self.requests < QUICK_RETRIES { RETRY_NS } else { SLOW_RETRY_NS };
        let streams = self.last_data_ns > 0 && now_ns.saturating_sub(self.last_data_ns) < SILENCE_NS;
        if streams || (self.requests > 0 && now_ns.saturating_sub(self.last_request_ns) < pause_ns) {
            return;
        }
        self.last_request_ns = now_ns;
        self.requests = self.requests.saturating_add(1);
        // Its records count from the start again.
        self.receiver.stream_restarted();
        // A network that is down (cable, interface) comes back; the silence is seen by everyone anyway.
        let _unreachable = self.request(self.start);
    }

    fn request(&self, command: Command) -> Result<(), SourceError> {
        self.door.send_to(&Request { command, sample_count: 0 }.to_bytes(), self.address)
    }
}

impl Drop for RdtSource {
    fn drop(&mut self) {
        // If it cannot be told, it will find out: nobody listens any more.
        let _unreachable = self.request(Command::Stop);
    }
}
