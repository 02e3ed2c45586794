//! Turns a capture by another program into a recording: samples and a configuration, no cycle records.

use std::fmt;
use std::path::Path;

use anyhow::bail;
use equipoise_adapters::recording::{Recorder, RecordingHeader};

use crate::replay::input::Input;
use crate::replay::left_out_lines;
use crate::replay::samples::{LeftOut, Sample};

/// What an import made.
#[derive(Debug, Clone)]
pub struct ImportSummary {
    /// Suit samples written.
    pub suit: u64,
    /// Ground samples written.
    pub ground: u64,
    /// From the first sample to the last, s.
    pub length_s: f64,
    /// Where the configuration in the header comes from.
    pub config_origin: String,
    /// What of the capture was not used.
    pub left_out: LeftOut,
}

/// Imports `file` into the new recording `out`, with the given configuration or defaults.
///
/// # Errors
/// A sentence: the file cannot be read or holds no sample, the configuration is refused, `out` exists or cannot be
/// written.
pub fn import(file: &Path, out: &Path, config: Option<&Path>) -> anyhow::Result<ImportSummary> {
    let input = Input::open(file)?;
    if let Input::Recording(_) = input {
        bail!("{} is a recording already; give it to `equipoise replay`", file.display());
    }
    let chosen = input.configuration(config)?;
    let mut samples = input.samples(&chosen.config)?;
    // Looked for first, so that nothing is created of a file without data.
    let Some(mut sample) = samples.next() else {
        let left_out = left_out_lines(&samples.left_out());
        bail!("{}: there is no sample in it that can be used\n{}", file.display(), left_out.trim_end());
    };
    let header = RecordingHeader {
        software_version: env!("CARGO_PKG_VERSION").to_owned(),
        started_monotonic_ns: input.started_ns(),
        config_toml: chosen.config.to_toml(),
        model_toml: chosen.config.model_toml(),
        ..RecordingHeader::default()
    };
    let mut recorder = Recorder::create(out, &header)?;
    let (mut suit, mut ground) = (0, 0);
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
                recorder.write(sample.delivered_ns(), &**message)?;
            }
        }
        match samples.next() {
            Some(next) => sample = next,
            None => break,
        }
    }
    recorder.finish()?;
    let length_s = last_ns.saturating_sub(first_ns) as f64 / 1e9;
    let left_out = samples.left_out();
    Ok(ImportSummary { suit, ground, length_s, config_origin: chosen.origin, left_out })
}

impl fmt::Display for ImportSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} suit and {} ground samples over {:.3} s", self.suit, self.ground, self.length_s)?;
        writeln!(f, "configuration: {}", self.config_origin)?;
        f.write_str(&left_out_lines(&self.left_out))
    }
}
