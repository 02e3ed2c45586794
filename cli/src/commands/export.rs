//! `equipoise export`: a recording in the format of another program.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::bail;
use equipoise_adapters::recording::Entry;
use equipoise_export::{Export, Format, Progress, Summary, Topic};
use equipoise_recording::replay::Replay;
use equipoise_recording::replay::input::Input;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

use super::{Outcome, span};
use crate::progress_bar::Bar;

/// Write a recording in the format of another program: tables, OpenSim, C3D
///
/// The ending of --out selects the format. Tables (.csv, .jsonl, .parquet): a row a message, a column a number; an invalid
/// value is empty, absent or null. OpenSim (.mot, .sto, .trc, or all of them with --format opensim) and C3D: ground reaction,
/// overload torques with 1-sigma and joint centres at the rate of the suit; states are computed by a replay if the recording
/// has none. docs/export.md has columns, axes, units and the marks of invalid values.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise export shift.mcap --out shift.parquet\n  equipoise export shift.mcap --out \
                        ground.csv --topic ground\n  equipoise export shift.mcap --out shift.c3d --span 60:90\n  equipoise \
                        export shift.mcap --format opensim --out shift-opensim\n\nExit code 3: part of the recording was \
                        damaged or is missing; what could be read is written."
)]
pub(super) struct Arguments {
    /// Recording; of a capture tables of states only
    file: PathBuf,
    /// File to write, or folder with --format opensim
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Format; by the ending of --out if not given
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Messages of a table
    #[arg(long, value_enum, default_value = "state")]
    topic: Topic,
    /// Part of the recording: begin and end, seconds since its begin
    #[arg(long, value_name = "A:B")]
    span: Option<String>,
    /// Configuration to compute the states with, in place of those recorded
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let Arguments { file, out, topic, config, .. } = arguments;
    if is_same_file(file, out) {
        bail!("--out {} is the recording itself; choose another name", out.display());
    }
    let format = arguments.format.map_or_else(|| Format::of(out), Ok)?;
    if *topic != Topic::State && !format.is_table() {
        bail!("--topic is for tables; {} holds values of states", out.display());
    }
    if *topic != Topic::State && config.is_some() {
        bail!(
            "--config computes states, and --topic selects recorded messages of another kind; leave one of them out"
        );
    }
    let span_s = span("--span", arguments.span.as_deref())?.map(|span| [span.from_s, span.to_s]);
    let export = Export {
        recording: file,
        states: None,
        is_replayed: config.is_some(),
        topic: *topic,
        format,
        span_s,
        out,
    };
    let input = Input::open(file)?;
    let needs_replay = match &input {
        Input::Recording(recording) => {
            let is_state = |entry: &Entry| matches!(entry, Entry::State(_));
            let recorded = || recording.entries().map_while(Result::ok).any(|timed| is_state(&timed.entry));
            *topic == Topic::State && (config.is_some() || !recorded())
        }
        _ if *topic == Topic::State && format.is_table() => true,
        _ => bail!("{} is a capture: make a recording of it by `equipoise import` first", file.display()),
    };
    let bar = Bar::new(false);
    if needs_replay { replayed(&input, export, config.as_deref(), &bar) } else { write(&export, &bar) }
}

/// Computes the states first, into a temporary recording next to the output, which is removed afterwards.
fn replayed(input: &Input, export: Export<'_>, config: Option<&Path>, bar: &Bar) -> anyhow::Result<Outcome> {
    // Without a slash at the end of a folder's name.
    let mut states: OsString = export.out.components().as_path().as_os_str().to_owned();
    states.push(format!(".{}.mcap", std::process::id()));
    let states = PathBuf::from(states);
    remove_on_signals(states.clone())?;
    let outcome = compute(input, export, config, &states, bar);
    // The recording is only an intermediate result; remove it even if the export failed.
    let _ = std::fs::remove_file(&states);
    outcome
}

fn compute(
    input: &Input,
    export: Export<'_>,
    config: Option<&Path>,
    states: &Path,
    bar: &Bar,
) -> anyhow::Result<Outcome> {
    let chosen = input.configuration(config)?;
    let replay = Replay { input, config: &chosen.config, as_recorded: config.is_none(), residual_s: None };
    let summary = bar.follow("computing states by a replay", input, || replay.run(Some(states)))?;
    bar.clear();
    println!("{}: {} states computed by a replay", export.recording.display(), summary.cycles);
    if let Some(fidelity) = &summary.fidelity {
        print!("{fidelity}");
    }
    for rejected in &summary.skipped.rejected {
        eprintln!("rejected: {rejected}");
    }
    let is_capture = !matches!(input, Input::Recording(_));
    let export = match is_capture {
        // A capture is no recording of samples; its table of states needs none.
        true => Export { recording: states, ..export },
        false => Export { states: Some(states), ..export },
    };
    let written = write(&export, &Bar::new(false))?;
    Ok(if summary.is_complete() { written } else { Outcome::PartRejected })
}

/// Removes a file before a signal ends the process: its states are personal data.
fn remove_on_signals(path: PathBuf) -> anyhow::Result<()> {
    let handled = [SIGHUP, SIGINT, SIGQUIT, SIGTERM].into_iter().filter(|&signal| !is_ignored(signal));
    let mut signals = Signals::new(handled)?;
    // The thread is not joined, because it waits for signals until the process ends.
    std::thread::spawn(move || {
        for signal in signals.forever() {
            let _ = std::fs::remove_file(&path);
            let _ = emulate_default_handler(signal);
        }
    });
    Ok(())
}

/// Whether this process was started with the signal ignored, as by `nohup`.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask =
        status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

fn write(export: &Export<'_>, bar: &Bar) -> anyhow::Result<Outcome> {
    let written = export.run(&mut Progress::new(&mut |doing, fraction| bar.update(doing, fraction)));
    bar.clear();
    let Summary { files, notes, rejected } = written?;
    for file in &files {
        println!("{}: {} rows of {} columns", file.path.display(), file.rows, file.columns);
    }
    for note in &notes {
        println!("{note}");
    }
    for reason in &rejected {
        eprintln!("rejected: {reason}");
    }
    Ok(if rejected.is_empty() { Outcome::Done } else { Outcome::PartRejected })
}

fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
