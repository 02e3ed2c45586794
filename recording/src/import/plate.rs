//! The second file of an import: the plate's measurements.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_adapters::capture::csv::TIME_BASE_NS;
use equipoise_adapters::capture::{BioWareCapture, BioWareSettings, Units};
use equipoise_config::Config;
use equipoise_core::message::GroundSample;

use crate::replay::input::Input;
use crate::replay::samples::{Sample, Samples, SkippedData};

/// Properties that the plate's file does not contain.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlateOptions {
    /// Units, if the file states none.
    pub units: Units,
    /// Number of the plate, from 1, if the file has several.
    pub plate: Option<usize>,
    /// Distances a and b of the sensors, m, if the file has eight channels.
    pub sensor_offsets_m: Option<[f64; 2]>,
    /// Time of the first row, or of a recording's start, ns since 1970.
    pub start_unix_ns: Option<u64>,
}

/// The plate's file. It can be read any number of times.
#[derive(Debug)]
pub(super) struct PlateFile {
    kind: Kind,
    options: PlateOptions,
}

#[derive(Debug)]
enum Kind {
    Text(PathBuf),
    /// A file that contains the plate's samples among others.
    Input(Input),
}

/// The plate's samples in order, counted from [`TIME_BASE_NS`].
pub(super) struct PlateSamples<'a> {
    source: Source<'a>,
    /// Added to the file's times, ns.
    later_ns: i64,
    start_unix_ns: Option<u64>,
}

enum Source<'a> {
    Text(Box<BioWareCapture<File>>),
    Input(Box<Samples<'a>>),
}

impl PlateFile {
    /// Opens the file; its extension determines the format.
    pub(super) fn open(path: &Path, options: PlateOptions) -> anyhow::Result<PlateFile> {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        let kind = match ending.as_deref() {
            Some("txt" | "tsv" | "csv") => Kind::Text(path.to_owned()),
            Some("pcap" | "pcapng" | "cap" | "mcap") => Kind::Input(Input::open(path)?),
            _ => bail!(
                "{}: give a plate's file that ends in .txt, .tsv, .csv, .pcap, .pcapng or .mcap",
                path.display()
            ),
        };
        Ok(PlateFile { kind, options })
    }

    pub(super) fn samples(&self, config: &Config) -> anyhow::Result<PlateSamples<'_>> {
        let (mut start_unix_ns, mut later_ns) = (self.options.start_unix_ns, 0);
        if let Kind::Input(Input::Recording(recording)) = &self.kind {
            // Its times are those of the recorder's CLOCK_MONOTONIC.
            let header = recording.header();
            later_ns = TIME_BASE_NS.wrapping_sub(header.started_monotonic_ns).cast_signed();
            start_unix_ns = start_unix_ns.or((header.started_unix_ns > 0).then_some(header.started_unix_ns));
        }
        let source = match &self.kind {
            Kind::Text(path) => {
                anyhow::ensure!(
                    config.ground.second.is_none(),
                    "{}: a text holds one plate, and the configuration's [ground.second] asks for two; leave that section out \
                     if this plate is the whole ground",
                    path.display()
                );
                let settings = BioWareSettings {
                    ground: config.ground.settings(),
                    units: self.options.units,
                    plate: self.options.plate,
                    sensor_offsets_m: self.options.sensor_offsets_m,
                };
                let capture = BioWareCapture::open(path, settings);
                Source::Text(Box::new(capture.with_context(|| path.display().to_string())?))
            }
            Kind::Input(input) => Source::Input(Box::new(input.samples(config)?)),
        };
        Ok(PlateSamples { source, later_ns, start_unix_ns })
    }
}

impl PlateSamples<'_> {
    pub(super) fn wall_clock_ns(&self) -> Option<u64> {
        self.start_unix_ns.or(match &self.source {
            Source::Text(capture) => capture.wall_clock_ns(),
            Source::Input(samples) => samples.wall_clock_ns(),
        })
    }

    pub(super) fn skipped(&self) -> SkippedData {
        match &self.source {
            Source::Text(capture) => {
                let rejected = capture.rejected();
                let rows = (!rejected.is_empty()).then(|| format!("rows of the plate left out: {rejected}"));
                let fault = capture.fault().map(|(line, cause)| {
                    format!(
                        "the plate's file cannot be read from line {line} on, later rows are missing: {cause}"
                    )
                });
                SkippedData { rejected: rows.into_iter().chain(fault).collect(), ignored: Vec::new() }
            }
            Source::Input(samples) => samples.skipped(),
        }
    }
}

impl Iterator for PlateSamples<'_> {
    type Item = GroundSample;

    fn next(&mut self) -> Option<GroundSample> {
        let mut ground = match &mut self.source {
            Source::Text(capture) => capture.next(),
            Source::Input(samples) => samples.find_map(|sample| match sample {
                Sample::Ground(ground) => Some(*ground),
                Sample::Suit(_) | Sample::Body(_) => None,
            }),
        }?;
        for time_ns in [&mut ground.sample_time_ns, &mut ground.arrival_ns, &mut ground.published_ns] {
            *time_ns = time_ns.saturating_add_signed(self.later_ns);
        }
        Some(ground)
    }
}
