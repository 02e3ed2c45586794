//! Checks that a recording, or the part of one subject, meets the requirements of a comparison: both streams, both with
//! changing data.

use std::ops::Range;

use anyhow::bail;
use equipoise_adapters::recording::{Entry, TimedEntry};
use equipoise_config::Config;
use equipoise_core::GRAVITY_M_PER_S2;
use equipoise_core::message::{GroundSample, SuitSample};
use equipoise_recording::replay::input::{Input, skipped_of};
use equipoise_recording::replay::samples::{Sample, SkippedData};
use equipoise_recording::replay::{self, with_skipped};

use super::Progress;
use crate::constants::{SAMPLES_MIN, STANDING_N, WEIGHT_DEVIATION_MAX};

/// Content of a recording.
#[derive(Debug)]
pub struct Survey {
    begin_ns: u64,
    /// The part that is used, CLOCK_MONOTONIC ns.
    part_ns: Range<u64>,
    suit: Stream,
    ground: Stream,
    /// Mean vertical force of each second since the begin in which a person stands on the plate, N.
    weight_n: Vec<(f64, f64)>,
    second: Second,
    /// Unused parts of the input.
    skipped: SkippedData,
    /// Its cycles, checkpoints and commands.
    pub(super) recorded: replay::survey::Survey,
}

/// Statistics of one stream.
#[derive(Debug, Clone, Default)]
struct Stream {
    samples: u64,
    first_ns: u64,
    last_ns: u64,
    /// The first sample's values, and whether any later sample differs.
    numbers: Vec<f64>,
    changes: bool,
}

/// Vertical force of the current second.
#[derive(Debug, Clone, Copy, Default)]
struct Second {
    number: u64,
    sum_n: f64,
    count: f64,
}

impl Stream {
    fn ingest(&mut self, time_ns: u64, numbers: impl Iterator<Item = f64>) {
        if self.samples == 0 {
            self.first_ns = time_ns;
            self.last_ns = time_ns;
            self.numbers = numbers.collect();
        } else {
            self.first_ns = self.first_ns.min(time_ns);
            self.last_ns = self.last_ns.max(time_ns);
            self.changes = self.changes || !self.numbers.iter().copied().eq(numbers);
        }
        self.samples += 1;
    }
}

impl Survey {
    /// Reads the input once, and uses the data of a part of it, CLOCK_MONOTONIC ns.
    ///
    /// # Errors
    /// The input cannot be read.
    pub fn of(
        input: &Input,
        config: &Config,
        part_ns: Range<u64>,
        progress: &mut dyn FnMut(Progress),
    ) -> anyhow::Result<Survey> {
        progress(Progress { doing: "reading the recording", fraction: 0.0 });
        let mut survey = Survey {
            begin_ns: input.begin_ns(config)?,
            part_ns: part_ns.clone(),
            suit: Stream::default(),
            ground: Stream::default(),
            weight_n: Vec::new(),
            second: Second::default(),
            skipped: SkippedData::default(),
            recorded: replay::survey::Survey::default(),
        };
        if let Input::Recording(recording) = input {
            let mut damage = None;
            for timed in recording.entries() {
                match timed {
                    Ok(timed) if part_ns.contains(&time_ns(&timed)) => survey.ingest(&timed.entry),
                    Ok(_) => {}
                    // Later passes stop at the same entry and report it.
                    Err(error) => damage = Some(error.to_string()),
                }
            }
            survey.skipped = skipped_of(recording, damage);
        } else {
            let mut samples = input.samples(config)?;
            for sample in samples.by_ref() {
                match sample {
                    Sample::Suit(sample) => survey.ingest_suit(&sample),
                    Sample::Ground(sample) => survey.ingest_ground(&sample),
                    Sample::Body(_) => {}
                }
            }
            survey.skipped = samples.skipped();
        }
        survey.end_second();
        Ok(survey)
    }

    fn ingest(&mut self, entry: &Entry) {
        match entry {
            Entry::Suit(sample) => self.ingest_suit(sample),
            Entry::Ground(sample) => self.ingest_ground(sample),
            entry => self.recorded.ingest(entry),
        }
    }

    fn ingest_suit(&mut self, sample: &SuitSample) {
        let numbers = sample.position_m.iter().flatten().chain(sample.orientation_wxyz.iter().flatten());
        self.suit.ingest(sample.sample_time_ns, numbers.copied());
    }

    fn ingest_ground(&mut self, sample: &GroundSample) {
        let numbers = sample.force_n.iter().chain(&sample.moment_nm);
        self.ground.ingest(sample.sample_time_ns, numbers.copied());
        let number = sample.sample_time_ns / 1_000_000_000;
        if number != self.second.number {
            self.end_second();
            self.second.number = number;
        }
        self.second.sum_n += sample.force_n[2];
        self.second.count += 1.0;
    }

    fn end_second(&mut self) {
        let mean_n = self.second.sum_n / self.second.count;
        if mean_n > STANDING_N {
            self.weight_n.push((self.second.number as f64, mean_n));
        }
        self.second = Second::default();
    }

    /// Whether a time is in the part that is used, ns.
    pub(super) fn covers(&self, time_ns: u64) -> bool {
        self.part_ns.contains(&time_ns)
    }

    /// Time origin t = 0, CLOCK_MONOTONIC ns of the recording.
    pub fn begin_ns(&self) -> u64 {
        self.begin_ns
    }

    /// A time of the recording relative to the origin, s.
    pub(super) fn seconds(&self, time_ns: u64) -> f64 {
        (i128::from(time_ns) - i128::from(self.begin_ns)) as f64 * 1e-9
    }

    /// Time span with both streams, s since the origin.
    pub fn samples_s(&self) -> [f64; 2] {
        [
            self.seconds(self.suit.first_ns.max(self.ground.first_ns)),
            self.seconds(self.suit.last_ns.min(self.ground.last_ns)),
        ]
    }

    /// Whether both streams exist with changing data.
    ///
    /// # Errors
    /// One sentence for each defect.
    pub fn check(&self) -> anyhow::Result<()> {
        match [self.suit.samples, self.ground.samples] {
            [0, 0] => bail!(self.with_skipped("the file contains no usable sample of suit or plate")),
            [0, plate] => bail!(self.with_skipped(&format!(
                "it contains {plate} samples of the plate and none of the suit; a comparison needs both: was the suit's \
                 adapter running, and is suit.listen its port?"
            ))),
            [suit, 0] => bail!(self.with_skipped(&format!(
                "it contains {suit} samples of the suit and none of the plate; a comparison needs both: was the plate's \
                 adapter running, and is ground.address its address?"
            ))),
            [suit, plate] if suit.min(plate) < SAMPLES_MIN => bail!(
                "it contains {suit} samples of the suit and {plate} of the plate, too few for a comparison; record at \
                 least 30 s"
            ),
            _ => {}
        }
        if !self.suit.changes {
            bail!(
                "the suit data never change: all {} samples are equal; check whether its software is paused or stuck, \
                 and record again",
                self.suit.samples
            );
        }
        if !self.ground.changes {
            bail!(
                "the plate data never change: all {} samples are equal, without any noise; check its cable and its \
                 amplifier, and record again",
                self.ground.samples
            );
        }
        let [from_s, to_s] = self.samples_s();
        if to_s - from_s < 1.0 {
            bail!(
                "suit and plate were not recorded at the same time: the suit has data from {:.1} s to {:.1} s, the \
                 plate from {:.1} s to {:.1} s",
                self.seconds(self.suit.first_ns),
                self.seconds(self.suit.last_ns),
                self.seconds(self.ground.first_ns),
                self.seconds(self.ground.last_ns)
            );
        }
        if self.weight_n.is_empty() {
            bail!("no person stands on the plate: its vertical force stays below {STANDING_N:.0} N");
        }
        Ok(())
    }

    /// An error about missing samples, with the reasons why data were not used, in one line.
    fn with_skipped(&self, what: &str) -> String {
        with_skipped(what, &self.skipped).replace('\n', "; ")
    }

    /// Checks the weight on the plate against the configured mass, in a span with held poses, s.
    ///
    /// # Errors
    /// A sentence with both masses.
    pub fn check_weight(&self, [from_s, to_s]: [f64; 2], config: &Config) -> anyhow::Result<()> {
        let Some(mass_kg) = config.subject.mass_kg else { return Ok(()) };
        let lies_in = |second: f64| {
            let time_s = second + 0.5 - self.begin_ns as f64 * 1e-9;
            time_s >= from_s && time_s < to_s
        };
        let mut forces_n: Vec<f64> =
            self.weight_n.iter().filter(|(second, _)| lies_in(*second)).map(|(_, mean_n)| *mean_n).collect();
        forces_n.sort_by(f64::total_cmp);
        // Temporary loads only add weight, so the lower quartile is the body weight.
        let Some(weight_n) = forces_n.get(forces_n.len() / 4) else { return Ok(()) };
        let measured_kg = weight_n / GRAVITY_M_PER_S2;
        if (measured_kg / mass_kg - 1.0).abs() > WEIGHT_DEVIATION_MAX {
            bail!(
                "in the identification span ({from_s:.0} s – {to_s:.0} s) the plate measures {measured_kg:.1} kg, but the \
                 configured mass of {} is {mass_kg:.1} kg: the recording or the configuration is of another worker, or a \
                 load is carried; give the right configuration with --config, or other poses with --identify",
                config.subject.id
            );
        }
        Ok(())
    }
}

/// Time of an entry, CLOCK_MONOTONIC ns.
fn time_ns(timed: &TimedEntry) -> u64 {
    match &timed.entry {
        Entry::Suit(sample) => sample.sample_time_ns,
        Entry::Ground(sample) => sample.sample_time_ns,
        // Its log time is that of messages before it; the state in its memory is of its cycle.
        Entry::Checkpoint(checkpoint) => {
            checkpoint.memory().map_or(timed.log_time_ns, |memory| memory.state.time_ns)
        }
        _ => timed.log_time_ns,
    }
}
