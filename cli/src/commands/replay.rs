//! `equipoise replay`: the same cycles again, from a file.

use std::path::{Path, PathBuf};

use anyhow::bail;
use equipoise_config::model::LoadedModel;
use equipoise_discrepancy::spans::Span;
use equipoise_recording::replay::Replay;
use equipoise_recording::replay::cross_validation::cross_validate;
use equipoise_recording::replay::input::Input;
use equipoise_recording::replay::score::SampleSelection;

use super::Outcome;
use crate::progress_bar::Bar;

/// Replay a recording or a capture: the same computation as live, faster than real time
///
/// A recording of `equipoise record` gives the live loop's states again, byte for byte, and says so. Imports and
/// captures (.csv, .mvnx, .pcap, .pcapng) are replayed at the configured loop rate. With --config or --model a recording's
/// cycles are computed afresh with other settings and the recorded tare, and not compared. Of a model that was found in
/// this very recording every effect holds in its own span; elsewhere those that lasted to the end hold all the time.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: equipoise replay shift.mcap --out shift.jsonl\n\nExit code 3: part of the data was \
                        rejected or is missing, or a state differs from the recorded one; the summary says what."
)]
pub(super) struct Arguments {
    /// Recording or capture
    file: PathBuf,
    /// Configuration to use in place of the recording's own
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Model file to use in place of the recording's or configuration's own; cycles are then computed afresh
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Write every state: .jsonl, .csv, .mcap; - for JSON lines on standard output
    #[arg(long, value_name = "RESULT")]
    out: Option<PathBuf>,
    /// Sum up the residual of the identified worker over this span only: begin and end, seconds since the recording's
    /// begin
    #[arg(long, value_name = "A:B")]
    work: Option<String>,
    /// Print the summary as JSON
    #[arg(long, conflicts_with = "cross_validate")]
    json: bool,
    /// Cross-validate the identified model in this number of blocks of time
    #[arg(long, value_name = "BLOCKS")]
    cross_validate: Option<usize>,
    /// No load is carried in the recording: cross-validation evaluates all samples, in motion too, in addition to static ones
    #[arg(long, requires = "cross_validate")]
    unloaded: bool,
    /// Maximum number of poses for cross-validation, each different from the others
    #[arg(long, value_name = "COUNT", requires = "cross_validate")]
    poses: Option<usize>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let file = &arguments.file;
    let input = Input::open(file)?;
    if arguments.out.as_deref().is_some_and(|out| is_same_file(file, out)) {
        bail!("--out {} is the input itself; choose another name", file.display());
    }
    let mut chosen = input.configuration(arguments.config.as_deref())?;
    if let Some(path) = &arguments.model {
        chosen.config.loaded_model = Some(LoadedModel::read(path)?);
    }
    let as_recorded = arguments.config.is_none() && arguments.model.is_none();
    let mut text = format!("{}\nconfiguration: {}\n", file.display(), chosen.origin);
    if let Some(mut model) = chosen.config.loaded_model.take() {
        if !as_recorded {
            model.fit_to(file, input.begin_ns(&chosen.config)?)?;
        }
        text += &format!("{}\n", model.describe());
        chosen.config.loaded_model = Some(model);
    }
    let work: Option<Span> = super::span("--work", arguments.work.as_deref())?;
    let residual_s = work.map(|span| [span.from_s, span.to_s]);
    let replay = Replay { input: &input, config: &chosen.config, as_recorded, residual_s };
    // Keep the display of the progress and the summary out of the results.
    let is_stream = arguments.out.as_deref().is_some_and(|out| out.as_os_str() == "-");
    let bar = Bar::new(is_stream);
    let summary = bar.follow("replaying", &input, || replay.run(arguments.out.as_deref()))?;
    text += &summary.to_string();
    if let Some(blocks) = arguments.cross_validate {
        let selections = [SampleSelection::QuasiStatic, SampleSelection::AllUnloaded];
        for selection in selections.into_iter().take(1 + usize::from(arguments.unloaded)) {
            let validate = || cross_validate(&input, &chosen.config, blocks, selection, arguments.poses);
            text += &bar.follow("cross-validating", &input, validate)?.to_string();
        }
    }
    bar.clear();
    if arguments.json {
        let json = format!("{:#}\n", summary.json());
        eprint!("{text}");
        text = json;
    }
    if is_stream {
        eprint!("{text}");
    } else {
        print!("{text}");
    }
    Ok(if summary.is_complete() { Outcome::Done } else { Outcome::PartRejected })
}

fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
