//! The samples of any input in the order of their delivery to the loop.

use std::collections::VecDeque;
use std::fs::File;
use std::io::BufReader;

use anyhow::bail;
use equipoise_adapters::capture::{CsvCapture, MvnxCapture, PcapCapture, WallClockSteps};
use equipoise_adapters::recording::{Entries, Entry, Recording};
use equipoise_config::ground::ati_rdt;
use equipoise_config::{Config, GroundSourceKind};
use equipoise_core::message::{GroundSample, SuitBody, SuitSample};
use equipoise_core::time::NS_PER_S;

use super::capture_file::CaptureFile;
use super::input::skipped_of;
use super::pcap::PcapSamples;

/// A recorder writes the pending messages stream by stream, so times in a file step back by less than this, ns.
const DISORDER_NS: u64 = 2 * NS_PER_S;

/// MVN's names of suits without one half of the body.
const HALF_BODIES: [&str; 2] = ["UpperBody", "LowerBody"];

/// One sample of a stream.
#[derive(Debug, Clone)]
pub enum Sample {
    /// Suit sample.
    Suit(Box<SuitSample>),
    /// Ground sample.
    Ground(Box<GroundSample>),
    /// The wearer's body dimensions according to the suit.
    Body(Box<SuitBody>),
}

impl Sample {
    /// Time of the sample, CLOCK_MONOTONIC ns.
    pub fn time_ns(&self) -> u64 {
        match self {
            Sample::Suit(sample) => sample.sample_time_ns,
            Sample::Ground(sample) => sample.sample_time_ns,
            Sample::Body(body) => body.published_ns,
        }
    }

    /// Delivery time to the loop: time of publication, or of arrival if it was not published. CLOCK_MONOTONIC ns.
    pub fn delivered_ns(&self) -> u64 {
        match self {
            Sample::Suit(sample) => sample.published_ns.max(sample.arrival_ns),
            Sample::Ground(sample) => sample.published_ns.max(sample.arrival_ns),
            Sample::Body(body) => body.published_ns.max(body.arrival_ns),
        }
    }
}

/// Unused parts of an input.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SkippedData {
    /// Data that should have been usable: one sentence for each kind.
    pub rejected: Vec<String>,
    /// Unrelated data, such as other network traffic: no fault.
    pub ignored: Vec<String>,
}

/// The samples of an input.
pub struct Samples<'a> {
    source: Source<'a>,
}

enum Source<'a> {
    Recording(&'a Recording, Box<Ordered<'a>>),
    Csv(Box<CsvCapture<File>>, Latencies, Option<Box<SuitSample>>),
    Mvnx(Box<MvnxCapture<BufReader<File>>>, Latencies, Option<Box<SuitBody>>),
    Pcap(Box<PcapSamples>),
}

/// Delay from motion and force to the time stamps in a file, for each stream, ns.
#[derive(Clone, Copy)]
struct Latencies {
    suit_ns: u64,
    ground_ns: u64,
}

impl Latencies {
    fn of(config: &Config) -> Latencies {
        Latencies { suit_ns: config.suit.latency_ns(), ground_ns: config.ground.latency_ns() }
    }
}

impl<'a> Samples<'a> {
    pub(super) fn of_recording(recording: &'a Recording) -> Samples<'a> {
        Samples { source: Source::Recording(recording, Box::new(Ordered::new(recording.entries()))) }
    }

    pub(super) fn of_csv(file: &CaptureFile, config: &Config) -> anyhow::Result<Samples<'a>> {
        let capture = Box::new(CsvCapture::new(file.open()?)?);
        Ok(Samples { source: Source::Csv(capture, Latencies::of(config), None) })
    }

    pub(super) fn of_mvnx(file: &CaptureFile, config: &Config) -> anyhow::Result<Samples<'a>> {
        let capture = Box::new(MvnxCapture::new(BufReader::with_capacity(1 << 16, file.open()?))?);
        if let Some(configuration) =
            capture.configuration().filter(|configuration| HALF_BODIES.contains(configuration))
        {
            bail!(
                "the suit was worn as {configuration}: the rest of the body was not measured, and balance is the whole body's"
            );
        }
        let body = capture.body().map(Box::new);
        Ok(Samples { source: Source::Mvnx(capture, Latencies::of(config), body) })
    }

    pub(super) fn of_pcap(file: &CaptureFile, config: &Config) -> anyhow::Result<Samples<'a>> {
        anyhow::ensure!(
            config.ground.source != GroundSourceKind::AtiRdt || ati_rdt::are_counts_given(&config.ground),
            "a capture has no page of the ATI device's settings: set ground.counts_per_newton and \
             ground.counts_per_newton_metre (live, the journal says what the page said)"
        );
        if config.ground.second.is_some() {
            anyhow::bail!(
                "{}: network captures of two ground devices are not read: [ground.second] needs both, and one alone is not \
                 the whole ground; record with `equipoise record` instead",
                file.path().display()
            );
        }
        let capture = PcapCapture::of_file(file.open()?, file.path())?;
        Ok(Samples { source: Source::Pcap(Box::new(PcapSamples::new(capture, config)?)) })
    }

    /// Wall-clock time of the first instant, by the clock of the computer that wrote the file, ns since 1970; `None` if
    /// it is not in the file or not read yet.
    pub fn wall_clock_ns(&self) -> Option<u64> {
        match &self.source {
            Source::Mvnx(capture, ..) => capture.wall_clock_ns(),
            Source::Pcap(samples) => samples.wall_clock_ns(),
            Source::Recording(..) | Source::Csv(..) => None,
        }
    }

    /// Unused parts so far; complete once the iterator has ended.
    pub fn skipped(&self) -> SkippedData {
        match &self.source {
            Source::Recording(recording, ordered) => {
                let mut skipped = skipped_of(recording, ordered.damage.clone());
                let ahead = Some(ordered.ahead).filter(|ahead| *ahead > 0);
                skipped.rejected.extend(ahead.map(|ahead| {
                    format!(
                        "{ahead} samples are dated after they were recorded: their adapter had another clock"
                    )
                }));
                skipped
            }
            Source::Csv(capture, ..) => {
                let rejected = capture.rejected();
                let note = (!rejected.is_empty()).then(|| format!("rows left out: {rejected}"));
                SkippedData { rejected: note.into_iter().collect(), ignored: Vec::new() }
            }
            Source::Mvnx(capture, ..) => {
                let rejected = capture.rejected();
                let note = (!rejected.is_empty()).then(|| format!("frames left out: {rejected}"));
                let fault = capture.fault().map(|fault| format!("{fault}; the frames before it were read"));
                let steps = describe_steps(capture.wall_clock_steps());
                SkippedData {
                    rejected: note.into_iter().chain(fault).collect(),
                    ignored: steps.into_iter().collect(),
                }
            }
            Source::Pcap(samples) => samples.skipped(),
        }
    }
}

/// The steps of an `.mvnx` file's wall clock in words.
fn describe_steps(steps: WallClockSteps) -> Option<String> {
    let WallClockSteps { forward, forward_ns, back } = steps;
    (steps != WallClockSteps::default()).then(|| {
        format!(
            "the wall clock steps forward {forward} times, {:.1} s in total (taken for missing frames; wrong if the clock \
             was set), and back {back} times (not followed)",
            forward_ns as f64 * 1e-9
        )
    })
}

impl Iterator for Samples<'_> {
    type Item = Sample;

    fn next(&mut self) -> Option<Sample> {
        match &mut self.source {
            Source::Recording(_, ordered) => ordered.next(),
            Source::Csv(capture, latencies, pending) => {
                if let Some(suit) = pending.take() {
                    return Some(Sample::Suit(suit));
                }
                let (mut suit, mut ground) = capture.next()?;
                suit.sample_time_ns = suit.sample_time_ns.saturating_sub(latencies.suit_ns);
                ground.sample_time_ns = ground.sample_time_ns.saturating_sub(latencies.ground_ns);
                *pending = Some(Box::new(suit));
                Some(Sample::Ground(Box::new(ground)))
            }
            Source::Mvnx(capture, latencies, body) => {
                if let Some(body) = body.take() {
                    return Some(Sample::Body(body));
                }
                let mut suit = capture.next()?;
                suit.sample_time_ns = suit.sample_time_ns.saturating_sub(latencies.suit_ns);
                Some(Sample::Suit(Box::new(suit)))
            }
            Source::Pcap(samples) => samples.next(),
        }
    }
}

/// The samples of a recording, sorted within a short look-ahead.
struct Ordered<'a> {
    entries: Entries<'a>,
    pending: VecDeque<Sample>,
    /// Number of samples that were stamped later than they were recorded: the live loop refuses them.
    ahead: u64,
    damage: Option<String>,
}

impl<'a> Ordered<'a> {
    fn new(entries: Entries<'a>) -> Ordered<'a> {
        Ordered { entries, pending: VecDeque::new(), ahead: 0, damage: None }
    }

    fn insert(&mut self, log_time_ns: u64, sample: Sample) {
        let time_ns = sample.delivered_ns();
        if time_ns > log_time_ns {
            self.ahead += 1;
            return;
        }
        // Insertion sort from the end, since the order is nearly correct. Equal times keep the file's order.
        let later = self.pending.iter().rev().take_while(|other| other.delivered_ns() > time_ns).count();
        self.pending.insert(self.pending.len() - later, sample);
    }

    fn spans_enough(&self) -> bool {
        match (self.pending.front(), self.pending.back()) {
            (Some(first), Some(last)) => last.delivered_ns() - first.delivered_ns() > DISORDER_NS,
            _ => false,
        }
    }
}

impl Iterator for Ordered<'_> {
    type Item = Sample;

    fn next(&mut self) -> Option<Sample> {
        while !self.spans_enough() {
            match self.entries.next() {
                Some(Ok(timed)) => match timed.entry {
                    Entry::Suit(sample) => self.insert(timed.log_time_ns, Sample::Suit(sample)),
                    Entry::Ground(sample) => self.insert(timed.log_time_ns, Sample::Ground(sample)),
                    Entry::Body(body) => self.insert(timed.log_time_ns, Sample::Body(body)),
                    _ => {}
                },
                Some(Err(error)) => self.damage = Some(error.to_string()),
                None => break,
            }
        }
        self.pending.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;
    use equipoise_adapters::recording::{Recorder, RecordingHeader};

    use super::*;

    #[test]
    fn a_sample_stamped_in_the_future_is_rejected_and_the_others_stay_in_order() {
        let mut recorder = Recorder::in_memory("a.mcap", &RecordingHeader::default()).unwrap();
        for (log_time_s, published_s) in [(1, 1), (2, 90), (3, 3), (2, 2), (4, 4)] {
            let published_ns = published_s * NS_PER_S;
            let sample = GroundSample { published_ns, ..GroundSample::zeroed() };
            recorder.write(log_time_s * NS_PER_S, &sample).unwrap();
        }
        let recording = Recording::from_bytes(recorder.into_bytes().unwrap()).unwrap();
        let mut samples = Samples::of_recording(&recording);
        let times_s: Vec<u64> = samples.by_ref().map(|sample| sample.delivered_ns() / NS_PER_S).collect();
        assert_eq!(times_s, [1, 2, 3, 4]);
        let rejected = samples.skipped().rejected;
        assert!(rejected.len() == 1 && rejected[0].starts_with("1 samples are dated after"), "{rejected:?}");
    }
}
