//! `equipoise-export`: one topic of a recording as a table. `equipoise export` starts it, with a replay before it where the
//! recording has no states.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use equipoise_export::{Summary, Topic, export};

/// Write the messages of a recording as a table: Parquet or CSV
///
/// `equipoise export` does the same, and computes states where a recording has none. docs/export.md has the columns.
#[derive(Debug, Parser)]
#[command(name = "equipoise-export", version)]
struct Arguments {
    /// Recording
    file: PathBuf,
    /// Table to write: .parquet or .csv
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Which messages
    #[arg(long, value_enum, default_value = "state")]
    topic: Topic,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match export(&arguments.file, arguments.topic, &arguments.out) {
        Ok(summary) => tell(&arguments, &summary),
        Err(error) => {
            eprintln!("equipoise-export: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn tell(arguments: &Arguments, summary: &Summary) -> ExitCode {
    println!("{}: {} rows of {} columns", arguments.out.display(), summary.rows, summary.columns);
    for what in &summary.rejected {
        eprintln!("rejected: {what}");
    }
    if summary.rejected.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(3) }
}
