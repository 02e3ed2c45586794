//! Input of a replay: a recording, or a capture of another program; and the configuration for it.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, bail};
use equipoise_adapters::capture::csv::TIME_BASE_NS;
use equipoise_adapters::recording::{Recording, Reloaded};
use equipoise_config::method::MASS_KG;
use equipoise_config::model::LoadedModel;
use equipoise_config::{Config, SuitPosition, similar};
use equipoise_core::GRAVITY_M_PER_S2;
use equipoise_core::cycle::{Settings, Similar};
use equipoise_core::time::NS_PER_S;

use super::capture_file::CaptureFile;
use super::samples::{Sample, Samples, SkippedData};
use super::survey::Survey;

/// From the start of a recording to its first sample, at most, ns; beyond, the clocks differ.
const START_AHEAD_MAX_NS: u64 = 600 * NS_PER_S;
/// Default stature, m.
const DEFAULT_HEIGHT_M: f64 = 1.75;
/// Configuration for captures without one: the manufacturers' default ports and scales.
const DEFAULT_CONFIG: &str = r#"
station = "station-1"
[suit]
source = "mvn-udp"
[ground]
source = "ati-rdt"
counts_per_newton = 1000000
counts_per_newton_metre = 1000000
[subject]
id = "anon-1"
height_m = 1.75
"#;

/// An open input. It can be read any number of times.
#[derive(Debug)]
pub enum Input {
    /// Written by `equipoise record` or `import`.
    Recording(Box<Recording>),
    /// Motion and forces as CSV.
    Csv(CaptureFile),
    /// Motion in MVN's export format; no forces.
    Mvnx(CaptureFile),
    /// Network traffic.
    Pcap(CaptureFile),
}

/// A configuration and its origin.
#[derive(Debug)]
pub struct Chosen {
    /// The configuration.
    pub config: Config,
    /// Origin in one sentence.
    pub origin: String,
}

impl Input {
    /// Opens a file; its extension determines the format.
    ///
    /// # Errors
    /// The file cannot be read, or its format is unknown.
    pub fn open(path: &Path) -> anyhow::Result<Input> {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        match ending.as_deref() {
            Some("mcap") => {
                let recording = Recording::open(path).with_context(|| path.display().to_string())?;
                Ok(Input::Recording(Box::new(recording)))
            }
            Some("csv") => Ok(Input::Csv(CaptureFile::new(path))),
            Some("mvnx") => Ok(Input::Mvnx(CaptureFile::new(path))),
            Some("pcap" | "pcapng" | "cap") => Ok(Input::Pcap(CaptureFile::new(path))),
            _ => bail!("{}: give a file that ends in .mcap, .csv, .mvnx, .pcap or .pcapng", path.display()),
        }
    }

    /// Time origin t = 0, CLOCK_MONOTONIC ns of the recording.
    pub fn started_ns(&self) -> u64 {
        match self {
            Input::Recording(recording) => recording.header().started_monotonic_ns,
            Input::Csv(_) | Input::Mvnx(_) | Input::Pcap(_) => TIME_BASE_NS,
        }
    }

    /// Time origin of spans in s, CLOCK_MONOTONIC ns: [`Input::started_ns`], unless the samples have another clock.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn begin_ns(&self, config: &Config) -> anyhow::Result<u64> {
        let (mut suit_ns, mut ground_ns) = (None, None);
        for sample in self.samples(config)? {
            match sample {
                Sample::Suit(sample) => suit_ns = suit_ns.or(Some(sample.sample_time_ns)),
                Sample::Ground(sample) => ground_ns = ground_ns.or(Some(sample.sample_time_ns)),
                Sample::Body(_) => {}
            }
            if suit_ns.is_some() && ground_ns.is_some() {
                break;
            }
        }
        let started_ns = self.started_ns();
        let first_ns = suit_ns.into_iter().chain(ground_ns).min().unwrap_or(started_ns);
        let is_ahead =
            first_ns.checked_sub(started_ns).is_some_and(|ahead_ns| ahead_ns <= START_AHEAD_MAX_NS);
        Ok(if is_ahead { started_ns } else { first_ns })
    }

    /// The samples in the order of delivery.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn samples(&self, config: &Config) -> anyhow::Result<Samples<'_>> {
        let (samples, file) = match self {
            Input::Recording(recording) => return Ok(Samples::of_recording(recording)),
            Input::Csv(file) => (Samples::of_csv(file, config), file),
            Input::Mvnx(file) => (Samples::of_mvnx(file, config), file),
            Input::Pcap(file) => (Samples::of_pcap(file, config), file),
        };
        samples.with_context(|| file.path().display().to_string())
    }

    /// Fraction of the file that the newest pass has read, 0 to 1; another thread may display it.
    pub fn fraction_read(&self) -> f64 {
        match self {
            Input::Recording(recording) => recording.fraction_read(),
            Input::Csv(file) | Input::Mvnx(file) | Input::Pcap(file) => file.fraction_read(),
        }
    }

    /// Surveys the recording; empty for a capture. Reads the file once.
    pub fn survey(&self) -> Survey {
        let mut survey = Survey::default();
        if let Input::Recording(recording) = self {
            // Stop at damage: the replay stops at the same entry and reports it.
            for timed in recording.entries().map_while(Result::ok) {
                survey.ingest(&timed.entry);
            }
        }
        survey
    }

    /// The configuration: the given file, otherwise the recording's own, otherwise defaults.
    ///
    /// # Errors
    /// The file is refused, or the recording has none that this release can read.
    pub fn configuration(&self, given: Option<&Path>) -> anyhow::Result<Chosen> {
        if let Some(path) = given {
            let mut config = Config::read(path)?;
            self.place_suit(&mut config);
            return Ok(Chosen { config, origin: format!("from {}", path.display()) });
        }
        if let Input::Recording(recording) = self {
            let text = &recording.header().config_toml;
            if text.is_empty() {
                bail!("the recording holds no configuration; name one with --config");
            }
            let mut config = Config::parse(text, "the recording's configuration")
                .context("this release cannot use it; name another with --config")?;
            let model = &recording.header().model_toml;
            if !model.is_empty() {
                let loaded = LoadedModel::parse(model.clone(), "of the recording".to_owned());
                config.loaded_model =
                    Some(loaded.context("this release cannot use it; name another with --model")?);
            }
            return Ok(Chosen { config, origin: "the recording's own".to_owned() });
        }
        let mut config = Config::parse(DEFAULT_CONFIG, "the default configuration")?;
        config.subject.height_m = DEFAULT_HEIGHT_M;
        self.place_suit(&mut config);
        let mut origin = format!("defaults; stature {DEFAULT_HEIGHT_M} m is assumed");
        if let Input::Csv(_) = self {
            // Such a capture may contain no static interval in which the loop could weigh the subject.
            config.subject.mass_kg = plausible_mass_kg(self.samples(&config)?);
            match config.subject.mass_kg {
                Some(mass_kg) => origin += &format!(", {mass_kg:.1} kg is the mean vertical force / g"),
                None => origin += ", the mass is not known",
            }
        }
        origin += "; name a configuration with --config";
        Ok(Chosen { config, origin })
    }

    /// The similar subject in the prior of a recording, if any.
    ///
    /// # Errors
    /// This release cannot read it.
    pub fn similar(&self) -> anyhow::Result<Option<Similar>> {
        let Input::Recording(recording) = self else { return Ok(None) };
        let text = &recording.header().similar_toml;
        similar::parse(text, "the recording's similar subject").map_err(anyhow::Error::msg)
    }

    /// The settings of each reload in a recording, by number.
    ///
    /// # Errors
    /// This release cannot read one of them.
    pub fn reloads(&self) -> anyhow::Result<BTreeMap<u64, Settings>> {
        let Input::Recording(recording) = self else { return Ok(BTreeMap::new()) };
        let settings = |(number, reloaded): (&u64, &Reloaded)| {
            let name = format!("the recording's configuration of reload {number}");
            let mut config = Config::parse(&reloaded.config_toml, &name)?;
            if !reloaded.model_toml.is_empty() {
                config.loaded_model = Some(LoadedModel::parse(reloaded.model_toml.clone(), name)?);
            }
            let name = format!("the recording's similar subject of reload {number}");
            let similar = similar::parse(&reloaded.similar_toml, &name).map_err(anyhow::Error::msg)?;
            Ok((*number, Settings { similar, ..config.settings() }))
        };
        recording.header().reloads.iter().map(settings).collect()
    }

    /// The CSV format uses one world frame for motion and forces, so the suit is not shifted unless configured.
    fn place_suit(&self, config: &mut Config) {
        if let Input::Csv(_) = self {
            config.suit.position.get_or_insert(SuitPosition::Absolute);
        }
    }
}

/// The mean vertical force as a mass, if plausible for a person.
fn plausible_mass_kg(samples: Samples<'_>) -> Option<f64> {
    let (mut sum_n, mut count) = (0.0, 0.0);
    for sample in samples {
        if let Sample::Ground(ground) = sample {
            sum_n += ground.force_n[2];
            count += 1.0;
        }
    }
    // Rounded to 0.01 kg for readability in the header.
    let mass_kg = (sum_n / count / GRAVITY_M_PER_S2 * 100.0).round() / 100.0;
    MASS_KG.contains(&mass_kg).then_some(mass_kg)
}

/// Unused parts of a recording; `damage` is the error that ended its entries, if any.
pub fn skipped_of(recording: &Recording, damage: Option<String>) -> SkippedData {
    let mut skipped = SkippedData::default();
    skipped.rejected.extend(damage);
    if recording.truncated() {
        skipped.rejected.push(Recording::TRUNCATED.to_owned());
    }
    skipped
}
