//! Recordings in the formats of other programs: tables (CSV, JSON lines, Parquet), files of OpenSim, C3D.
//!
//! Tables hold every field of a message. Motion formats hold joint centres, ground reaction and overload torques at a fixed
//! rate. A value that must not be used is marked as invalid as each format does it, by the rules of the state's JSON.
//!
//! Layers, lowest first: `part`, `progress`, `identity` → [`table`], `motion` → `opensim` → `c3d` → here
#![forbid(unsafe_code)]

mod c3d;
mod identity;
mod motion;
mod opensim;
mod part;
mod progress;
pub mod table;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_adapters::recording::Recording;

use motion::{Motion, Source};
use opensim::Kind;
pub use progress::Progress;
pub use table::Topic;
use table::{Form, Job};

/// Format of the output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Table: comma-separated values
    Csv,
    /// Table: JSON lines
    Jsonl,
    /// Table: Apache Parquet
    Parquet,
    /// OpenSim: ground reaction as external load
    Mot,
    /// OpenSim: overload torques with 1-sigma
    Sto,
    /// OpenSim: joint centres
    Trc,
    /// OpenSim: these three files in a folder
    Opensim,
    /// Points, moments and a force platform
    C3d,
}

impl Format {
    /// The format of a file by the ending of its name.
    ///
    /// # Errors
    /// An unknown ending.
    pub fn of(out: &Path) -> anyhow::Result<Format> {
        let ending = out.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        Ok(match ending.as_deref() {
            Some("csv") => Format::Csv,
            Some("jsonl") => Format::Jsonl,
            Some("parquet") => Format::Parquet,
            Some("mot") => Format::Mot,
            Some("sto") => Format::Sto,
            Some("trc") => Format::Trc,
            Some("c3d") => Format::C3d,
            _ => bail!(
                "--out {}: give a name that ends in .csv, .jsonl, .parquet, .mot, .sto, .trc or .c3d, or a folder with \
                 --format opensim",
                out.display()
            ),
        })
    }

    /// Whether the output is a table of messages.
    pub fn is_table(self) -> bool {
        matches!(self, Format::Csv | Format::Jsonl | Format::Parquet)
    }
}

/// An export.
#[derive(Debug, Clone, Copy)]
pub struct Export<'a> {
    /// Recording with samples, and with states unless `states` is given.
    pub recording: &'a Path,
    /// States computed from it by a replay.
    pub states: Option<&'a Path>,
    /// Whether that replay began without the memory of the live loop, because a configuration was given.
    pub is_replayed: bool,
    /// Messages of a table.
    pub topic: Topic,
    /// Format of the output.
    pub format: Format,
    /// Begin and end, s since the start of the recording; `None` for all of it.
    pub span_s: Option<[f64; 2]>,
    /// File or folder to write.
    pub out: &'a Path,
}

/// A written file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// Path of the file.
    pub path: PathBuf,
    /// Rows or frames.
    pub rows: u64,
    /// Columns, or points and channels.
    pub columns: usize,
}

/// Result of an export.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Summary {
    /// Written files.
    pub files: Vec<Written>,
    /// Remarks on values that are left out.
    pub notes: Vec<String>,
    /// Data of the recording that could not be read.
    pub rejected: Vec<String>,
}

impl Export<'_> {
    /// Writes the output; each file is complete or absent.
    ///
    /// # Errors
    /// The recording cannot be read or has no such values, or a file cannot be written.
    pub fn run(&self, progress: &mut Progress<'_>) -> anyhow::Result<Summary> {
        let open = |path: &Path| Recording::open(path).with_context(|| path.display().to_string());
        let recording = open(self.recording)?;
        let computed = self.states.map(open).transpose()?;
        let states = computed.as_ref().unwrap_or(&recording);
        let mut summary = Summary::default();
        let form = match self.format {
            Format::Csv => Some(Form::Csv),
            Format::Jsonl => Some(Form::JsonLines),
            Format::Parquet => Some(Form::Parquet),
            Format::Mot | Format::Sto | Format::Trc | Format::Opensim | Format::C3d => None,
        };
        if let Some(form) = form {
            let recording = if self.topic == Topic::State { states } else { &recording };
            let job = Job { recording, topic: self.topic, form, span_s: self.span_s, out: self.out };
            summary.files.push(job.run(&mut summary.rejected, progress)?);
            return Ok(summary);
        }
        let source =
            Source { states, samples: &recording, is_replayed: self.is_replayed, span_s: self.span_s };
        self.write_motion(source, &mut summary, progress)?;
        Ok(summary)
    }

    fn write_motion(
        &self,
        source: Source<'_>,
        summary: &mut Summary,
        progress: &mut Progress<'_>,
    ) -> anyhow::Result<()> {
        let motion = Motion::survey(source, progress)?;
        let report = match self.format {
            Format::Mot => opensim::write_file(&motion, Kind::GroundReaction, self.out, progress),
            Format::Sto => opensim::write_file(&motion, Kind::Torques, self.out, progress),
            Format::Trc => opensim::write_file(&motion, Kind::JointCentres, self.out, progress),
            Format::C3d => {
                let subjects = identity::subjects(source.samples.header());
                c3d::write(&motion, &subjects, self.out, progress)
            }
            Format::Opensim | Format::Csv | Format::Jsonl | Format::Parquet => {
                opensim::write_folder(&motion, self.out, progress)
            }
        }?;
        (summary.files, summary.notes, summary.rejected) = (report.files, report.notes, motion.rejected);
        Ok(())
    }
}
