//! A recording's messages as a table: a row per message, a column per number.
//!
//! A value that must not be used is null in Parquet, an empty field in CSV and an absent key in JSON lines, by the same rules
//! as in the JSON of a state.
//!
//! Layers, lowest first: `names` → [`rules`] → [`columns`](mod@columns) → `csv`, `json_lines`, `parquet` → here

pub mod columns;
mod csv;
mod json_lines;
mod names;
mod parquet;
pub mod rules;

use std::fs::File;
use std::path::Path;

use anyhow::bail;
use equipoise_adapters::recording::{Recording, RecordingHeader};
use equipoise_core::message::{CycleRecord, GroundSample, State, SuitSample};

use crate::part::Part;
use crate::{Progress, Written};
use columns::{Column, Row, columns};
use rules::Exported;

/// Which messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Topic {
    /// States of the loop, a row a cycle; computed by a replay if the recording has no states
    State,
    /// Samples of the suit
    Suit,
    /// Samples of the ground
    Ground,
    /// Stamps of each cycle
    Cycle,
}

/// Kind of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    Csv,
    JsonLines,
    Parquet,
}

/// What is written, and where.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Job<'a> {
    pub(crate) recording: &'a Recording,
    pub(crate) topic: Topic,
    pub(crate) form: Form,
    /// Begin and end, s since the start of the recording.
    pub(crate) span_s: Option<[f64; 2]>,
    pub(crate) out: &'a Path,
}

impl Job<'_> {
    /// Writes the table; `rejected` receives the data that could not be read.
    ///
    /// # Errors
    /// The recording has no such message, or the file cannot be written.
    pub(crate) fn run(
        &self,
        rejected: &mut Vec<String>,
        progress: &mut Progress<'_>,
    ) -> anyhow::Result<Written> {
        progress.begin("writing");
        match self.topic {
            Topic::State => self.write::<State>("state", rejected, progress),
            Topic::Suit => self.write::<SuitSample>("sample of a suit", rejected, progress),
            Topic::Ground => self.write::<GroundSample>("sample of the ground", rejected, progress),
            Topic::Cycle => self.write::<CycleRecord>("cycle record", rejected, progress),
        }
    }

    fn write<M: Exported>(
        &self,
        what: &str,
        rejected: &mut Vec<String>,
        progress: &mut Progress<'_>,
    ) -> anyhow::Result<Written> {
        let (recording, columns) = (self.recording, columns::<M>());
        let part = Part::next_to(self.out)?;
        let mut sink = sink::<M>(recording.header(), self.form, part.file()?, &columns)?;
        let started_ns = recording.header().started_monotonic_ns;
        let mut rows = 0;
        let mut entries = recording.entries();
        while let Some(timed) = entries.next() {
            match timed {
                Ok(timed) => {
                    let message = M::of(&timed.entry).filter(|message| self.is_in_span(*message, started_ns));
                    if let Some(message) = message {
                        rows += 1;
                        sink.write(&Row::of(message, &columns, started_ns))?;
                    }
                }
                Err(damage) => rejected.push(damage.to_string()),
            }
            progress.update(entries.fraction_read());
        }
        if recording.truncated() {
            rejected.push(Recording::TRUNCATED.to_owned());
        }
        if rows == 0 {
            let lines: String = rejected.iter().map(|reason| format!("\nrejected: {reason}")).collect();
            let span = self.span_s.map_or_else(String::new, |[from, to]| format!(" from {from} to {to} s"));
            bail!("there is no {what} in it{span}{lines}");
        }
        sink.finish()?;
        part.take_place(self.out)?;
        Ok(Written { path: self.out.to_owned(), rows, columns: columns.len() })
    }

    fn is_in_span<M: Exported>(&self, message: &M, started_ns: u64) -> bool {
        let time_s = (i128::from(message.row_time_ns()) - i128::from(started_ns)) as f64 / 1e9;
        self.span_s.is_none_or(|[from_s, to_s]| (from_s..=to_s).contains(&time_s))
    }
}

/// Destination of rows.
trait Sink {
    fn write(&mut self, row: &Row) -> anyhow::Result<()>;
    fn finish(&mut self) -> anyhow::Result<()>;
}

fn sink<M: Exported>(
    header: &RecordingHeader,
    form: Form,
    file: File,
    columns: &[Column],
) -> anyhow::Result<Box<dyn Sink>> {
    Ok(match form {
        Form::Csv => Box::new(csv::Table::begin(file, columns)?),
        Form::JsonLines => Box::new(json_lines::Table::begin(file, columns)),
        Form::Parquet => Box::new(parquet::Table::begin(file, columns, footer::<M>(header, columns))?),
    })
}

/// What the footer of a Parquet file holds, by key.
fn footer<M: Exported>(header: &RecordingHeader, columns: &[Column]) -> Vec<(String, String)> {
    let units: serde_json::Map<String, serde_json::Value> =
        columns.iter().filter_map(|column| Some((column.name.clone(), column.unit?.into()))).collect();
    let pairs = [
        ("type_name", M::TYPE_NAME.to_owned()),
        ("schema_hash", format!("{:016x}", M::SCHEMA_HASH)),
        ("software_version", header.software_version.clone()),
        ("exported_by", env!("CARGO_PKG_VERSION").to_owned()),
        ("station", crate::identity::station(header)),
        ("subject", crate::identity::subjects(header).join(", ")),
        ("started_monotonic_ns", header.started_monotonic_ns.to_string()),
        ("started_unix_ns", header.started_unix_ns.to_string()),
        ("units", serde_json::Value::Object(units).to_string()),
        ("names", names::numbers().to_string()),
        ("config_toml", header.config_toml.clone()),
    ];
    pairs.into_iter().map(|(key, value)| (format!("equipoise.{key}"), value)).collect()
}
