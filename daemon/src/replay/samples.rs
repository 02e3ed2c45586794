//! Samples of any input in the order in which they are delivered to the loop.

use std::collections::VecDeque;
use std::fs::File;
use std::path::Path;

use equipoise_adapters::capture::{CsvCapture, CsvError};
use equipoise_adapters::recording::{Entries, Entry, Recording};
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_core::time::NS_PER_S;

use super::input::left_out_of;
use super::pcap::PcapSamples;
use crate::config::Config;

/// A recorder writes what it finds stream by stream, so times in a file step back by less than this, ns.
const DISORDER_NS: u64 = 2 * NS_PER_S;

/// One sample of either stream.
#[derive(Debug, Clone)]
pub enum Sample {
    /// Of the suit.
    Suit(Box<SuitSample>),
    /// Of the ground.
    Ground(Box<GroundSample>),
}

impl Sample {
    /// When it reached the loop's door: published, or arrived where nobody published it. CLOCK_MONOTONIC ns.
    pub fn delivered_ns(&self) -> u64 {
        match self {
            Sample::Suit(sample) => sample.published_ns.max(sample.arrival_ns),
            Sample::Ground(sample) => sample.published_ns.max(sample.arrival_ns),
        }
    }
}

/// What of an input was not used.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LeftOut {
    /// Data that should have been usable: one sentence for each kind.
    pub rejected: Vec<String>,
    /// What is none of ours, and no fault: other traffic.
    pub passed_over: Vec<String>,
}

/// The samples of an input.
pub struct Samples<'a> {
    source: Source<'a>,
}

enum Source<'a> {
    Recording(&'a Recording, Ordered<'a>),
    Csv(Box<CsvCapture<File>>, Latencies, Option<Box<SuitSample>>),
    Pcap(Box<PcapSamples>),
}

/// How much later than its motion, or its force, each half of a CSV's row was written, ns.
#[derive(Clone, Copy)]
struct Latencies {
    suit_ns: u64,
    ground_ns: u64,
}

impl<'a> Samples<'a> {
    pub(super) fn of_recording(recording: &'a Recording) -> Samples<'a> {
        Samples { source: Source::Recording(recording, Ordered::new(recording.entries())) }
    }

    pub(super) fn of_csv(path: &Path, config: &Config) -> Result<Samples<'a>, CsvError> {
        let latencies =
            Latencies { suit_ns: config.suit.latency_ns(), ground_ns: config.ground.latency_ns() };
        Ok(Samples { source: Source::Csv(Box::new(CsvCapture::open(path)?), latencies, None) })
    }

    pub(super) fn of_pcap(path: &Path, config: &Config) -> anyhow::Result<Samples<'a>> {
        Ok(Samples { source: Source::Pcap(Box::new(PcapSamples::open(path, config)?)) })
    }

    /// What was left out so far; complete once the iterator has ended.
    pub fn left_out(&self) -> LeftOut {
        match &self.source {
            Source::Recording(recording, ordered) => left_out_of(recording, ordered.damage.clone()),
            Source::Csv(capture, ..) => {
                let rejected = capture.rejected();
                let told = (!rejected.is_empty()).then(|| format!("rows left out: {rejected}"));
                LeftOut { rejected: told.into_iter().collect(), passed_over: Vec::new() }
            }
            Source::Pcap(samples) => samples.left_out(),
        }
    }
}

impl Iterator for Samples<'_> {
    type Item = Sample;

    fn next(&mut self) -> Option<Sample> {
        match &mut self.source {
            Source::Recording(_, ordered) => ordered.next(),
            Source::Csv(capture, latencies, waiting) => {
                if let Some(suit) = waiting.take() {
                    return Some(Sample::Suit(suit));
                }
                let (mut suit, mut ground) = capture.next()?;
                suit.sample_time_ns = suit.sample_time_ns.saturating_sub(latencies.suit_ns);
                ground.sample_time_ns = ground.sample_time_ns.saturating_sub(latencies.ground_ns);
                *waiting = Some(Box::new(suit));
                Some(Sample::Ground(Box::new(ground)))
            }
            Source::Pcap(samples) => samples.next(),
        }
    }
}

/// The samples of a recording, put in order within a short look-ahead.
struct Ordered<'a> {
    entries: Entries<'a>,
    waiting: VecDeque<Sample>,
    damage: Option<String>,
}

impl<'a> Ordered<'a> {
    fn new(entries: Entries<'a>) -> Ordered<'a> {
        Ordered { entries, waiting: VecDeque::new(), damage: None }
    }

    fn insert(&mut self, sample: Sample) {
        let time_ns = sample.delivered_ns();
        // Nearly in order already: the place is near the end. Equal times keep the file's order.
        let later = self.waiting.iter().rev().take_while(|other| other.delivered_ns() > time_ns).count();
        self.waiting.insert(self.waiting.len() - later, sample);
    }

    fn spans_enough(&self) -> bool {
        match (self.waiting.front(), self.waiting.back()) {
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
                    Entry::Suit(sample) => self.insert(Sample::Suit(sample)),
                    Entry::Ground(sample) => self.insert(Sample::Ground(sample)),
                    _ => {}
                },
                Some(Err(error)) => self.damage = Some(error.to_string()),
                None => break,
            }
        }
        self.waiting.pop_front()
    }
}
