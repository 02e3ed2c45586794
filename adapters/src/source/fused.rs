//! Two devices, each read by its own thread so that neither delays the other, and fused here.

use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded, never};
use equipoise_core::message::{AdapterHealth, GroundSample};

use super::error::SourceError;
use super::ground::GroundSource;
use crate::clock::now_monotonic_ns;
use crate::counts::{Counts, HealthReporter, Stream};
use crate::ground::fusion::{Fusion, FusionSettings};

/// Capacity of the queue between a device's thread and the fusion: more than a second of the fastest device. Messages
/// that do not fit are dropped and counted.
const MESSAGES_MAX: usize = 8192;
/// Timeout of one receive call: short, as the wait of a sample for its partner may end meanwhile.
const WAIT: Duration = Duration::from_millis(10);
/// A device without data for this long is reported as silent, ns.
const SILENT_NS: u64 = 500_000_000;

/// Interval at which a device's thread reports its state, ns; shorter in case of a fault.
const STATUS_INTERVAL_NS: u64 = 100_000_000;

/// Message of a device's thread.
enum DeviceMessage {
    /// Samples, oldest first.
    Samples(Vec<GroundSample>),
    /// State of the device.
    Status { counts: Box<Counts>, block_latency_ns: u64, diagnostic: Option<String>, note: Option<String> },
    /// The thread has failed.
    Failed(SourceError),
}

/// State of one of the two devices in the fusion.
#[derive(Debug)]
struct Device {
    /// Name in the configuration.
    name: String,
    last_arrival_ns: u64,
    counts: Counts,
    block_latency_ns: u64,
    diagnostic: Option<String>,
    note: Option<String>,
    thread: Option<JoinHandle<()>>,
}

/// Two ground devices that form one ground.
#[derive(Debug)]
pub struct FusedSource {
    fusion: Fusion,
    messages: Receiver<(usize, DeviceMessage)>,
    devices: [Device; 2],
    health: HealthReporter,
}

impl FusedSource {
    /// Starts reading both devices, each with its name in the configuration.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(
        sources: [(String, GroundSource); 2],
        settings: FusionSettings,
    ) -> Result<FusedSource, SourceError> {
        let (sender, messages) = bounded(MESSAGES_MAX);
        let now_ns = now_monotonic_ns();
        let mut devices = Vec::with_capacity(2);
        for (index, (name, source)) in sources.into_iter().enumerate() {
            let reader = Reader { index, source, sender: sender.clone(), missed: 0 };
            let thread = std::thread::Builder::new()
                .name(format!("ground-{}", index + 1))
                .spawn(move || reader.run())
                .map_err(|error| SourceError::Unusable(format!("{name}: no thread to read it: {error}")))?;
            let (counts, block_latency_ns) = (Counts::default(), 0);
            let thread = Some(thread);
            let (diagnostic, note) = (None, None);
            devices.push(Device {
                name,
                last_arrival_ns: now_ns,
                counts,
                block_latency_ns,
                diagnostic,
                note,
                thread,
            });
        }
        let Ok(devices) = devices.try_into() else {
            return Err(SourceError::Unusable("two devices are fused, no fewer and no more".to_owned()));
        };
        let (fusion, health) = (Fusion::new(settings), HealthReporter::new(Stream::Ground, now_ns));
        Ok(FusedSource { fusion, messages, devices, health })
    }

    /// Waits briefly and appends the complete samples to `samples`; returns their count.
    ///
    /// # Errors
    /// A fault of either device that requires intervention.
    pub fn receive(&mut self, samples: &mut Vec<GroundSample>) -> Result<usize, SourceError> {
        let before = samples.len();
        match self.messages.recv_timeout(WAIT) {
            Ok((index, message)) => self.process(index, message)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(SourceError::Unusable("the threads that read both devices are gone".to_owned()));
            }
        }
        while let Ok((index, message)) = self.messages.try_recv() {
            self.process(index, message)?;
        }
        self.fusion.fused(now_monotonic_ns(), samples);
        Ok(samples.len() - before)
    }

    fn process(&mut self, index: usize, message: DeviceMessage) -> Result<(), SourceError> {
        let now_ns = now_monotonic_ns();
        match message {
            DeviceMessage::Samples(samples) => {
                self.devices[index].last_arrival_ns = now_ns;
                for sample in samples {
                    self.fusion.push(index, sample, now_ns);
                }
            }
            DeviceMessage::Status { counts, block_latency_ns, diagnostic, note } => {
                let device = &mut self.devices[index];
                (device.counts, device.block_latency_ns) = (*counts, block_latency_ns);
                (device.diagnostic, device.note) = (diagnostic, note);
            }
            DeviceMessage::Failed(error) => return Err(error),
        }
        Ok(())
    }

    /// The current fault of either device and its remedy, in a sentence; `None` without a fault.
    pub fn diagnostic(&self) -> Option<String> {
        let now_ns = now_monotonic_ns();
        let diagnostics: Vec<String> =
            self.devices.iter().filter_map(|device| device.diagnostic_at(now_ns)).collect();
        (!diagnostics.is_empty()).then(|| diagnostics.join("; "))
    }

    /// Properties that the devices report, in a sentence; `None` if there are none.
    pub fn note(&self) -> Option<String> {
        let reported = |device: &Device| device.note.as_ref().map(|note| format!("{}: {note}", device.name));
        let notes: Vec<String> = self.devices.iter().filter_map(reported).collect();
        (!notes.is_empty()).then(|| notes.join("; "))
    }

    /// Counts of both devices since the start, and of samples without a partner; `published` counts fused samples.
    pub fn counts(&self) -> Counts {
        let mut all = *self.fusion.counts();
        for device in &self.devices {
            all.received += device.counts.received;
            all.lost += device.counts.lost;
            for (sum, more) in all.refused.iter_mut().zip(device.counts.refused) {
                *sum += more;
            }
        }
        all
    }

    /// The counts as a message, with the rate since the last call.
    pub fn health(&mut self) -> AdapterHealth {
        let health = self.health.report(&self.counts(), now_monotonic_ns());
        let block_latency_ns = self.devices.iter().map(|device| device.block_latency_ns).max();
        AdapterHealth { block_latency_ns: block_latency_ns.unwrap_or(0), ..health }
    }
}

impl Device {
    fn diagnostic_at(&self, now_ns: u64) -> Option<String> {
        if let Some(diagnostic) = &self.diagnostic {
            return Some(format!("{}: {diagnostic}", self.name));
        }
        let silent = now_ns.saturating_sub(self.last_arrival_ns) > SILENT_NS;
        silent.then(|| format!("{} sends nothing; is it on, and is its cable in?", self.name))
    }
}

impl Drop for FusedSource {
    fn drop(&mut self) {
        // Without a receiver, both threads end at their next message: within the interval of their reports.
        self.messages = never();
        for thread in self.devices.iter_mut().filter_map(|device| device.thread.take()) {
            // A reader that panicked has no further messages.
            let _panicked = thread.join();
        }
    }
}

/// Reads one device until the fusion no longer receives.
struct Reader {
    index: usize,
    source: GroundSource,
    sender: Sender<(usize, DeviceMessage)>,
    /// Samples dropped because the queue was full.
    missed: u64,
}

/// The fusion no longer exists.
struct Disconnected;

impl Reader {
    fn run(mut self) {
        if let Ok(error) = self.read() {
            // Unlike the others, this message must not be dropped, so it waits for room.
            let _ = self.sender.send((self.index, DeviceMessage::Failed(error)));
        }
    }

    /// Returns the error of the device.
    fn read(&mut self) -> Result<SourceError, Disconnected> {
        let (mut reported, mut reported_ns) = (None, 0);
        loop {
            let mut samples = Vec::new();
            if let Err(error) = self.source.receive(&mut samples) {
                return Ok(error);
            }
            if !samples.is_empty() {
                let count = samples.len() as u64;
                self.missed += if self.try_send(DeviceMessage::Samples(samples))? { 0 } else { count };
            }
            let (diagnostic, now_ns) = (self.source.diagnostic(), now_monotonic_ns());
            if now_ns.saturating_sub(reported_ns) >= STATUS_INTERVAL_NS
                || reported.as_ref() != Some(&diagnostic)
            {
                let mut counts = Box::new(*self.source.counts());
                counts.lost += self.missed;
                let block_latency_ns = self.source.block_latency_ns();
                // If the queue is full, the report is repeated later.
                let note = self.source.note();
                if self.try_send(DeviceMessage::Status {
                    counts,
                    block_latency_ns,
                    diagnostic: diagnostic.clone(),
                    note,
                })? {
                    (reported, reported_ns) = (Some(diagnostic), now_ns);
                }
            }
        }
    }

    /// Whether there was room for the message.
    fn try_send(&self, message: DeviceMessage) -> Result<bool, Disconnected> {
        match self.sender.try_send((self.index, message)) {
            Ok(()) => Ok(true),
            Err(TrySendError::Full(_)) => Ok(false),
            Err(TrySendError::Disconnected(_)) => Err(Disconnected),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::transport::{Incoming, Transport};
    use super::*;
    use crate::ground::GroundSettings;
    use crate::ground::device::bota::{Bota, BotaSettings};

    /// A transport whose failure after opening is permanent.
    struct Broken;

    impl Transport for Broken {
        fn open(&mut self) -> Result<(), SourceError> {
            Ok(())
        }

        fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError> {
            Err(SourceError::Unusable("it is broken".to_owned()))
        }

        fn send(&mut self, _bytes: &[u8]) -> Result<(), SourceError> {
            Ok(())
        }
    }

    fn reader(sender: Sender<(usize, DeviceMessage)>) -> Reader {
        let device = Box::new(Bota::new(BotaSettings { baud: 460_800, sinc: None }));
        let source = GroundSource::open(Box::new(Broken), device, GroundSettings::default()).unwrap();
        Reader { index: 1, source, sender, missed: 0 }
    }

    #[test]
    fn a_reader_ends_with_an_unread_report_once_the_fusion_is_gone() {
        let (sender, messages) = bounded(1);
        sender.try_send((0, DeviceMessage::Samples(Vec::new()))).unwrap();
        let reader = reader(sender);
        let (ended, has_ended) = bounded::<()>(0);
        let thread = std::thread::spawn(move || {
            let _ended = ended;
            reader.run();
        });
        let waits = has_ended.recv_timeout(10 * WAIT);
        assert_eq!(waits, Err(RecvTimeoutError::Timeout), "why it failed is not said yet");
        drop(messages);
        assert_eq!(has_ended.recv_timeout(Duration::from_secs(10)), Err(RecvTimeoutError::Disconnected));
        thread.join().unwrap();
    }

    #[test]
    fn the_last_word_comes_once_there_is_room() {
        let (sender, messages) = bounded(1);
        sender.try_send((0, DeviceMessage::Samples(Vec::new()))).unwrap();
        let reader = reader(sender);
        let thread = std::thread::spawn(move || reader.run());
        assert!(matches!(messages.recv(), Ok((0, DeviceMessage::Samples(_)))));
        let last = messages.recv_timeout(Duration::from_secs(10));
        assert!(matches!(last, Ok((1, DeviceMessage::Failed(SourceError::Unusable(_))))));
        thread.join().unwrap();
    }
}
