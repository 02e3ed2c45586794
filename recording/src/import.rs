//! Converts captures of other programs to a recording with samples and a configuration, but without cycle records.

mod join;
mod plate;
pub mod unix_time;

use std::fmt;
use std::path::Path;

use anyhow::bail;
use equipoise_adapters::recording::{Recorder, RecordingHeader};

pub use self::join::{Join, Joined};
use self::join::{JoinedSamples, find};
use self::plate::PlateFile;
pub use self::plate::PlateOptions;
use crate::replay::input::{Chosen, Input};
use crate::replay::samples::{Sample, Samples, SkippedData};
use crate::replay::{skipped_lines, with_skipped};

/// A vertical force on the person below this, N, is more than noise: the plate's sign or axes are wrong.
const WRONG_SIGN_N: f64 = -50.0;

/// The plate's file that accompanies the suit's.
#[derive(Debug, Clone, Copy)]
pub struct With<'a> {
    /// Path of the file.
    pub plate: &'a Path,
    /// Properties that the file does not contain.
    pub options: PlateOptions,
    /// How the clocks are aligned.
    pub join: Join,
}

/// Result of an import.
#[derive(Debug, Clone)]
pub struct ImportSummary {
    /// Number of suit samples written.
    pub suit: u64,
    /// Number of ground samples written.
    pub ground: u64,
    /// From the first sample to the last, s.
    pub length_s: f64,
    /// Origin of the configuration in the header.
    pub config_origin: String,
    /// How two files were aligned.
    pub joined: Option<Joined>,
    /// Unused data of the captures.
    pub skipped: SkippedData,
}

/// Imports `input`, the opened `file`, optionally with the plate's file, into the new recording `out`, with the given
/// configuration or defaults.
///
/// # Errors
/// A file cannot be read or holds no sample, the two cannot be aligned, the configuration is refused, `out` exists or
/// cannot be written.
pub fn import(
    input: &Input,
    file: &Path,
    with: Option<&With<'_>>,
    out: &Path,
    config: Option<&Path>,
) -> anyhow::Result<ImportSummary> {
    if let Input::Recording(_) = input {
        bail!("{} is a recording already; give it to `equipoise replay`", file.display());
    }
    let chosen = input.configuration(config)?;
    let Some(with) = with else {
        return write(
            ImportSamples::One(Box::new(input.samples(&chosen.config)?)),
            file,
            &chosen,
            out,
            input.started_ns(),
        );
    };
    if config.is_none() {
        bail!(
            "--with needs --config FILE, whose [ground.frame] says where the plate stands, and which way its z points"
        );
    }
    let plate = PlateFile::open(with.plate, with.options)?;
    let joined = find(input, &plate, &chosen.config, with.join)?;
    let samples = JoinedSamples::new(input, &plate, &chosen.config, &joined)?;
    let mut summary = write(ImportSamples::Two(Box::new(samples)), file, &chosen, out, input.started_ns())?;
    summary.joined = Some(joined);
    Ok(summary)
}

/// The samples of one file or of two.
enum ImportSamples<'a> {
    One(Box<Samples<'a>>),
    Two(Box<JoinedSamples<'a>>),
}

impl ImportSamples<'_> {
    fn skipped(&self) -> SkippedData {
        match self {
            ImportSamples::One(samples) => samples.skipped(),
            ImportSamples::Two(samples) => samples.skipped(),
        }
    }
}

impl Iterator for ImportSamples<'_> {
    type Item = Sample;

    fn next(&mut self) -> Option<Sample> {
        match self {
            ImportSamples::One(samples) => samples.next(),
            ImportSamples::Two(samples) => samples.next(),
        }
    }
}

fn write(
    mut samples: ImportSamples<'_>,
    file: &Path,
    chosen: &Chosen,
    out: &Path,
    started_monotonic_ns: u64,
) -> anyhow::Result<ImportSummary> {
    // Read the first sample before creating a file, so that none is created without data.
    let Some(mut sample) = samples.next() else {
        let what = format!("{}: it contains no usable sample", file.display());
        bail!("{}", with_skipped(&what, &samples.skipped()));
    };
    let header = RecordingHeader {
        software_version: env!("CARGO_PKG_VERSION").to_owned(),
        started_monotonic_ns,
        config_toml: chosen.config.clone().for_recording().to_toml(),
        model_toml: chosen.config.model_toml(),
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(out, &header)?;
    let (mut suit, mut ground, mut upside_down) = (0, 0, 0_u64);
    let (first_ns, mut last_ns) = (sample.delivered_ns(), 0);
    loop {
        last_ns = sample.delivered_ns().max(last_ns);
        match &sample {
            Sample::Suit(message) => {
                suit += 1;
                recorder.write(sample.delivered_ns(), &**message)?;
            }
            Sample::Ground(message) => {
                ground += 1;
                upside_down += u64::from(message.force_n[2] < WRONG_SIGN_N);
                recorder.write(sample.delivered_ns(), &**message)?;
            }
            Sample::Body(message) => recorder.write(sample.delivered_ns(), &**message)?,
        }
        match samples.next() {
            Some(next) => sample = next,
            None => break,
        }
    }
    recorder.finish()?;
    let length_s = last_ns.saturating_sub(first_ns) as f64 / 1e9;
    let mut skipped = samples.skipped();
    if upside_down * 2 > ground {
        skipped.rejected.push(format!(
            "in {upside_down} of {ground} ground samples the person pulls the plate up: `measures` or `axes` of \
             [ground.frame] is the other one"
        ));
    }
    let config_origin = chosen.origin.clone();
    Ok(ImportSummary { suit, ground, length_s, config_origin, joined: None, skipped })
}

impl fmt::Display for ImportSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} suit and {} ground samples over {:.3} s", self.suit, self.ground, self.length_s)?;
        writeln!(f, "configuration: {}", self.config_origin)?;
        if let Some(joined) = &self.joined {
            writeln!(f, "{joined}")?;
        }
        f.write_str(&skipped_lines(&self.skipped))
    }
}
