//! `equipoise export`: a recording as a table for other programs; the table is written by a program of its own.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail};
use clap::ValueEnum;
use equipoise_adapters::recording::Entry;
use equipoise_recording::replay::Replay;
use equipoise_recording::replay::input::Input;

use super::Outcome;

/// The program that writes tables.
const PROGRAM: &str = "equipoise-export";

/// Write a recording as a table: Parquet or CSV, a row a message, a column a number
///
/// Every field of the message; joints, segments and axes by name; times in seconds of the recording's clock next to the
/// stamps. A value that must not be used is null (Parquet) or empty (CSV). A Parquet file says in its footer what units,
/// numbers and bits mean, and holds the configuration. docs/export.md has the columns.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise export shift.mcap --out shift.parquet\n  equipoise export shift.mcap --out \
                        ground.csv --topic ground\n  python3 -c 'import pandas; \
                        print(pandas.read_parquet(\"shift.parquet\").describe())'\n\nTables are written by the program \
                        equipoise-export, which is in the directory of this one:\n  cargo build --release -p \
                        equipoise-export\n\nExit code 3: part of the recording was damaged or is missing; what could be \
                        read is written."
)]
pub(super) struct Arguments {
    /// Recording; of a capture states only
    file: PathBuf,
    /// Table to write: .parquet or .csv
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Which messages
    #[arg(long, value_enum, default_value = "state")]
    topic: Topic,
    /// Configuration to compute the states with, in place of those recorded
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Topic {
    /// States of the loop, a row a cycle; computed by a replay where the recording has no states
    State,
    /// Samples of the suit
    Suit,
    /// Samples of the ground
    Ground,
    /// Stamps of each cycle
    Cycle,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let Arguments { file, out, topic, config } = arguments;
    if is_same_file(file, out) {
        bail!("--out {} is the recording itself; choose another name", out.display());
    }
    let input = Input::open(file)?;
    let Input::Recording(recording) = &input else {
        if *topic != Topic::State {
            bail!("{} is a capture: make a recording of it by `equipoise import` first", file.display());
        }
        return replayed(&input, arguments);
    };
    let is_state = |entry: &Entry| matches!(entry, Entry::State(_));
    let recorded = || recording.entries().map_while(Result::ok).any(|timed| is_state(&timed.entry));
    if *topic == Topic::State && (config.is_some() || !recorded()) {
        return replayed(&input, arguments);
    }
    write(file, *topic, out)
}

/// Computes the states first, into a temporary recording next to the table, which is removed afterwards.
fn replayed(input: &Input, arguments: &Arguments) -> anyhow::Result<Outcome> {
    let mut states: OsString = arguments.out.as_os_str().to_owned();
    states.push(format!(".{}.mcap", std::process::id()));
    let states = PathBuf::from(states);
    let outcome = compute(input, arguments, &states);
    // The recording is only an intermediate result; remove it even if the export failed.
    let _ = std::fs::remove_file(&states);
    outcome
}

fn compute(input: &Input, arguments: &Arguments, states: &Path) -> anyhow::Result<Outcome> {
    let config = arguments.config.as_deref();
    let chosen = input.configuration(config)?;
    let replay = Replay { input, config: &chosen.config, as_recorded: config.is_none(), residual_s: None };
    let summary = replay.run(Some(states))?;
    println!("{}: {} states computed by a replay", arguments.file.display(), summary.cycles);
    for rejected in &summary.skipped.rejected {
        eprintln!("rejected: {rejected}");
    }
    let written = write(states, Topic::State, &arguments.out)?;
    Ok(if summary.skipped.rejected.is_empty() { written } else { Outcome::PartRejected })
}

/// Has the table written.
fn write(recording: &Path, topic: Topic, out: &Path) -> anyhow::Result<Outcome> {
    let here = std::env::current_exe().context("where this program lies")?;
    let program = here.with_file_name(PROGRAM);
    let topic = topic.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default();
    let ended =
        Command::new(&program).arg(recording).arg("--out").arg(out).args(["--topic", &topic]).status();
    let ended = ended.with_context(|| {
        format!(
            "cannot start {}: build it with cargo build --release -p {PROGRAM}, into the directory of this program",
            program.display()
        )
    })?;
    match ended.code() {
        Some(0) => Ok(Outcome::Done),
        Some(3) => Ok(Outcome::PartRejected),
        _ => bail!("{PROGRAM} did not write {}: it says why above", out.display()),
    }
}

fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
