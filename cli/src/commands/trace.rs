//! `equipoise trace`: a recording's cycles for Perfetto and chrome://tracing.

use std::fs::OpenOptions;
use std::io::BufWriter;
use std::ops::RangeInclusive;
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;

use anyhow::{Context, bail};
use equipoise_adapters::recording::Recording;
use equipoise_recording::trace::write_trace;

use super::Outcome;

/// The owner writes, the group reads, others have no access.
const MODE: u32 = 0o640;
/// Maximum number of ranges in an error message.
const RANGES_NAMED_MAX: usize = 8;

/// Turn the cycles of a recording or flight record into a trace for Perfetto and chrome://tracing
///
/// Every stage of every cycle as a slice, missed deadlines, skipped slots and commands as instants, lateness and samples
/// taken as counters. Open it with ui.perfetto.dev, which keeps it in the browser.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise trace station-1-cycle-4711.mcap -o trace.json\n         equipoise trace \
                        shift.mcap -o trace.json --cycles 60000-61000\n\nA file is never overwritten. Exit code 3: \
                        the recording is damaged or cut short; the cycles before the damage are in the trace."
)]
pub(super) struct Arguments {
    /// Recording, or flight record, to read
    file: PathBuf,
    /// Trace to create
    #[arg(short, long, value_name = "OUT.json")]
    out: PathBuf,
    /// Only these cycles, the first and the last included
    #[arg(long, value_name = "A-B", value_parser = range)]
    cycles: Option<RangeInclusive<u64>>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let Arguments { file, out, cycles } = arguments;
    let recording = Recording::open(file).with_context(|| file.display().to_string())?;
    let mut options = OpenOptions::new();
    options.write(true).create_new(true).mode(MODE);
    let created = options.open(out).with_context(|| format!("cannot create {}", out.display()))?;
    let summary = write_trace(&recording, cycles.as_ref(), &mut BufWriter::new(created))
        // Remove an incomplete trace, which would block the next attempt.
        .inspect_err(|_| drop(std::fs::remove_file(out)))
        .with_context(|| format!("cannot write {}", out.display()))?;
    if let Some(damage) = &summary.damage {
        eprintln!("equipoise: {damage}");
    } else if recording.truncated() {
        eprintln!("equipoise: {}", Recording::TRUNCATED);
    }
    let Some((first, last)) = summary.span else {
        // Remove a trace without cycles, which would block the next attempt.
        let _ = std::fs::remove_file(out);
        bail!("{}: {}", file.display(), no_cycles(&summary.available));
    };
    println!(
        "{}: {} cycles, {first} to {last}, {} deadlines missed",
        out.display(),
        summary.cycles,
        summary.deadlines_missed
    );
    let is_whole = summary.damage.is_none() && !recording.truncated();
    Ok(if is_whole { Outcome::Done } else { Outcome::PartRejected })
}

/// Why a trace has no cycles; `available` are the ranges of the recording.
fn no_cycles(available: &[RangeInclusive<u64>]) -> String {
    let named = available.iter().take(RANGES_NAMED_MAX);
    let named: Vec<String> = named.map(|range| format!("{}-{}", range.start(), range.end())).collect();
    let more = match available.len().saturating_sub(RANGES_NAMED_MAX) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    if named.is_empty() {
        return "no cycles, which only a recording of `equipoise record` and a flight record have".to_owned();
    }
    format!("no such cycles; --cycles selects from {}{more}", named.join(", "))
}

/// `A-B`, both included.
fn range(text: &str) -> Result<RangeInclusive<u64>, String> {
    let ends = text.split_once('-').and_then(|(from, to)| Some((from.parse().ok()?, to.parse().ok()?)));
    let message = || "give the first and the last cycle, for example 60000-61000".to_owned();
    ends.filter(|(from, to)| from <= to).map(|(from, to)| from..=to).ok_or_else(message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_available_ranges_are_named_up_to_a_limit() {
        assert_eq!(no_cycles(&[7..=9, 1..=4]), "no such cycles; --cycles selects from 7-9, 1-4");
        let many: Vec<RangeInclusive<u64>> = (0..10).map(|index| 2 * index..=2 * index).collect();
        assert!(no_cycles(&many).ends_with("14-14 and 2 more"));
        assert!(no_cycles(&[]).starts_with("no cycles, which only"));
    }
}
