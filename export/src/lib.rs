//! A recording's messages as a table for other programs: every field a column, a row a message; Parquet or CSV.
//!
//! A value that must not be used is null in Parquet and an empty field in CSV, by the same rules as in the JSON of a state.
//! A crate of its own, for Parquet's takes longer to build than the rest of what reads recordings.
//!
//! Floors, ground first: `names` → [`rules`] → [`columns`](mod@columns) → `csv`, `parquet`, `part` → here
#![forbid(unsafe_code)]

pub mod columns;
mod csv;
mod names;
mod parquet;
mod part;
pub mod rules;

use std::fs::File;
use std::path::Path;

use anyhow::{Context, bail};
use equipoise_adapters::recording::{Recording, RecordingHeader};
use equipoise_core::message::{CycleRecord, GroundSample, State, SuitSample};

use columns::{Column, Row, columns};
use part::Part;
use rules::Exported;

/// Which messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Topic {
    /// Published states, a row a cycle
    State,
    /// Samples of the suit
    Suit,
    /// Samples of the ground
    Ground,
    /// Stamps of each cycle
    Cycle,
}

/// What became of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// Rows written.
    pub rows: u64,
    /// Columns of each.
    pub columns: usize,
    /// What of the file could not be used, in words.
    pub rejected: Vec<String>,
}

/// Exports one topic of a recording into a file, which is there whole or not at all.
///
/// # Errors
/// The recording cannot be read or has no such message, an unknown ending, a file that cannot be written.
pub fn export(recording: &Path, topic: Topic, out: &Path) -> anyhow::Result<Summary> {
    let form = Form::of(out)?;
    let recording = Recording::open(recording).with_context(|| recording.display().to_string())?;
    let part = Part::next_to(out)?;
    let summary = match topic {
        Topic::State => write::<State>(&recording, form, &part, "state"),
        Topic::Suit => write::<SuitSample>(&recording, form, &part, "sample of a suit"),
        Topic::Ground => write::<GroundSample>(&recording, form, &part, "sample of the ground"),
        Topic::Cycle => write::<CycleRecord>(&recording, form, &part, "cycle record"),
    }?;
    part.take_place(out)?;
    Ok(summary)
}

/// What kind of table a name asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Csv,
    Parquet,
}

impl Form {
    fn of(out: &Path) -> anyhow::Result<Form> {
        let ending = out.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        match ending.as_deref() {
            Some("csv") => Ok(Form::Csv),
            Some("parquet") => Ok(Form::Parquet),
            _ => bail!("--out {}: give a name that ends in .parquet or .csv", out.display()),
        }
    }
}

fn write<M: Exported>(recording: &Recording, form: Form, part: &Part, what: &str) -> anyhow::Result<Summary> {
    let columns = columns::<M>();
    let mut sink = sink::<M>(recording.header(), form, part.file()?, &columns)?;
    let started_ns = recording.header().started_monotonic_ns;
    let mut summary = Summary { rows: 0, columns: columns.len(), rejected: Vec::new() };
    for timed in recording.entries() {
        match timed {
            Ok(timed) => {
                if let Some(message) = M::of(&timed.entry) {
                    summary.rows += 1;
                    sink.write(&Row::of(message, &columns, started_ns))?;
                }
            }
            Err(damage) => summary.rejected.push(damage.to_string()),
        }
    }
    if recording.truncated() {
        let cut = "the recording was cut short: the data after its last complete chunk are missing";
        summary.rejected.push(cut.to_owned());
    }
    if summary.rows == 0 {
        let summary: String =
            summary.rejected.iter().map(|summary| format!("\nrejected: {summary}")).collect();
        bail!("there is no {what} in it{summary}");
    }
    sink.finish()?;
    Ok(summary)
}

/// Where rows go.
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
        Form::Parquet => Box::new(parquet::Table::begin(file, columns, metadata::<M>(header, columns))?),
    })
}

/// What stands in the footer of a Parquet file, by key.
fn metadata<M: Exported>(header: &RecordingHeader, columns: &[Column]) -> Vec<(String, String)> {
    let units: serde_json::Map<String, serde_json::Value> =
        columns.iter().filter_map(|column| Some((column.name.clone(), column.unit?.into()))).collect();
    // Accepts recordings of any release: only these two keys are read, and a configuration without them is exported as
    // it is.
    let config: toml::Table = header.config_toml.parse().unwrap_or_default();
    let text =
        |value: Option<&toml::Value>| value.and_then(toml::Value::as_str).unwrap_or_default().to_owned();
    let configured = text(config.get("subject").and_then(|subject| subject.get("id")));
    let pairs = [
        ("type_name", M::TYPE_NAME.to_owned()),
        ("schema_hash", format!("{:016x}", M::SCHEMA_HASH)),
        ("software_version", header.software_version.clone()),
        ("exported_by", env!("CARGO_PKG_VERSION").to_owned()),
        ("station", text(config.get("station"))),
        ("subject", header.subjects(&configured).join(", ")),
        ("started_monotonic_ns", header.started_monotonic_ns.to_string()),
        ("started_unix_ns", header.started_unix_ns.to_string()),
        ("units", serde_json::Value::Object(units).to_string()),
        ("names", names::numbers().to_string()),
        ("config_toml", header.config_toml.clone()),
    ];
    pairs.into_iter().map(|(key, value)| (format!("equipoise.{key}"), value)).collect()
}
