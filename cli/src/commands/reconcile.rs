//! `equipoise reconcile`: discrepancies between model and measurement, the missing effect, and the gap before and after it
//! is added.

mod session;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_config::Config;
use equipoise_config::model::LoadedModel;
use equipoise_config::model_file::Fitted;
use equipoise_discrepancy::Options;
use equipoise_discrepancy::finding::Finding;
use equipoise_discrepancy::spans::Given;
use equipoise_discrepancy::workflow::output::{Results, check_verdicts, folders};
use equipoise_discrepancy::workflow::summary::Summary;
use equipoise_discrepancy::workflow::{Compared, Reconcile};
use equipoise_files::sha256_of;
use equipoise_recording::replay::input::{Chosen, Input};
use equipoise_recording::replay::skipped_lines;

use super::{Outcome, StationArgument, span};
use crate::progress_bar::Bar;

/// Locate discrepancies between model and measurement, name the missing effect, add it to the model
///
/// Reads a recording (.mcap) or a capture (.csv, .pcap, .pcapng, with --config), identifies the worker from the
/// identification poses, compares the model's predictions with the plate's measurements, and determines which effect of
/// the catalogue is missing, such as a load in a hand, a displaced plate or a lag of the suit. Spans that are not given
/// are determined from the recording and printed.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise reconcile shift.mcap --out shift-reconciled\n  equipoise reconcile shift.mcap \
                  --identify 0:95 --reference 95:240 --work 240:900 --json\n  equipoise reconcile capture.csv --config \
                  examples/human-motion.toml --identify 0:30\n  equipoise replay shift.mcap --model \
                  shift-reconciled/model.toml\n  equipoise reconcile --session --station press-3 --out found\n\nExit code 3: part of the data was rejected or is missing; the rest was \
                  used, and the summary lists it."
)]
pub(super) struct Arguments {
    /// Recordings or captures; several are processed in sequence
    #[arg(required_unless_present = "session", conflicts_with = "session", value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Record a running station, evaluate at each Enter, and ask for the next measurement until the finding is decided
    #[arg(long, requires = "out")]
    session: bool,
    #[command(flatten)]
    station: StationArgument,
    /// Configuration that replaces the recording's own
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Model file of the effects already found; those that `equipoise model reject` marked are not considered again
    #[arg(long, value_name = "MODEL")]
    model: Option<PathBuf>,
    /// Identification poses: begin and end, seconds since the recording's begin; with several workers, of one of them
    #[arg(long, value_name = "A:B")]
    identify: Option<String>,
    /// Work known to be clean
    #[arg(long, value_name = "A:B")]
    reference: Option<String>,
    /// Work in question
    #[arg(long, value_name = "A:B")]
    work: Option<String>,
    /// Write model.toml, report.html and report.md here; of several files, each into a folder of its name. A model.toml
    /// with verdicts of `equipoise model` is replaced only if --model names it
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the finding as JSON; of several files, one line each
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    // Wrong spans are refused before any file is read.
    arguments.given()?;
    if let Some(folder) = arguments.out.as_deref().filter(|_| arguments.session) {
        return session::run(arguments, folder);
    }
    let folders = arguments.out.as_deref().map(|out| folders(out, &arguments.files)).transpose()?;
    let mut outcome = Outcome::Done;
    for (index, file) in arguments.files.iter().enumerate() {
        let folder = folders.as_ref().map(|folders| folders[index].as_path());
        let of_file = one(arguments, file, folder).with_context(|| file.display().to_string())?;
        if of_file == Outcome::PartRejected {
            outcome = Outcome::PartRejected;
        }
    }
    Ok(outcome)
}

impl Arguments {
    fn given(&self) -> anyhow::Result<Given> {
        Ok(Given {
            identify: span("--identify", self.identify.as_deref())?,
            reference: span("--reference", self.reference.as_deref())?,
            work: span("--work", self.work.as_deref())?,
        })
    }
}

/// A reconciled file.
struct Evaluated {
    input: Input,
    config: Config,
    /// File, configuration and model, in words.
    head: String,
    compared: Compared,
    outcome: equipoise_discrepancy::Outcome,
}

/// Reconciles one file. If the results go to a folder, it must not hold verdicts that they would replace.
fn evaluate(arguments: &Arguments, file: &Path, folder: Option<&Path>) -> anyhow::Result<Evaluated> {
    let input = Input::open(file)?;
    let mut chosen = input.configuration(arguments.config.as_deref())?;
    same_subject(&input, &chosen)?;
    if let Some(path) = &arguments.model {
        chosen.config.loaded_model = Some(LoadedModel::read(path)?);
    }
    if let Some(folder) = folder {
        check_verdicts(folder, chosen.config.loaded_model.as_ref().map(LoadedModel::file))?;
    }
    let mut head = format!("{}\nconfiguration: {}\n", file.display(), chosen.origin);
    if let Some(mut model) = chosen.config.loaded_model.take() {
        model.fit_to(file, input.begin_ns(&chosen.config)?)?;
        head += &format!("{}\n", model.describe());
        chosen.config.loaded_model = Some(model);
    }
    let config = chosen.config;
    let reconcile = Reconcile { input: &input, config: &config, given: arguments.given()? };
    let bar = Bar::new(arguments.json);
    let compared = reconcile.compare(&mut |progress| bar.update(progress.doing, progress.fraction))?;
    let rejected = config.loaded_model.iter().flat_map(|model| model.file().rejected());
    let options = Options { excluded: rejected.map(Fitted::name).collect(), ..Options::default() };
    let outcome = equipoise_discrepancy::reconcile(&compared.session, &options, &mut |fraction| {
        bar.update("testing effects", fraction);
    })?;
    bar.clear();
    Ok(Evaluated { input, config, head, compared, outcome })
}

impl Evaluated {
    /// Prints the finding, and what of the file could not be used.
    fn print(&self, arguments: &Arguments) -> anyhow::Result<()> {
        let skipped = skipped_lines(&self.compared.skipped);
        if arguments.json {
            self.print_finding(arguments)?;
            eprint!("{skipped}");
        } else {
            print!("{}", self.head);
            self.print_finding(arguments)?;
            print!("{skipped}");
        }
        Ok(())
    }

    fn print_finding(&self, arguments: &Arguments) -> anyhow::Result<()> {
        let finding = &self.outcome.finding;
        if arguments.json {
            return print_json(finding, arguments.session || arguments.files.len() > 1);
        }
        print!("{}", Summary { compared: &self.compared, finding });
        Ok(())
    }
}

/// Reconciles one file and writes the results; returns whether all of it was used.
fn one(arguments: &Arguments, file: &Path, folder: Option<&Path>) -> anyhow::Result<Outcome> {
    let mut evaluated = evaluate(arguments, file, folder)?;
    let written = match folder {
        Some(folder) => {
            let command = std::env::args().collect::<Vec<String>>().join(" ");
            let results = Results { folder, file, sha256: &sha256_of(file)?, command };
            let Evaluated { input, config, compared, outcome, .. } = &mut evaluated;
            let reconcile = Reconcile { input, config, given: arguments.given()? };
            results.write(&reconcile, compared, outcome)?
        }
        None => Vec::new(),
    };
    evaluated.print(arguments)?;
    if !arguments.json {
        for path in written.iter().rev().take(3) {
            println!("written: {}", path.display());
        }
    }
    let rejected = &evaluated.compared.skipped.rejected;
    Ok(if rejected.is_empty() { Outcome::Done } else { Outcome::PartRejected })
}

/// One line where there are several, so that each is read as it comes.
fn print_json(finding: &Finding, one_line: bool) -> anyhow::Result<()> {
    let text =
        if one_line { serde_json::to_string(finding)? } else { serde_json::to_string_pretty(finding)? };
    println!("{text}");
    Ok(())
}

/// Rejects the configuration of a worker who is not in the recording: its model would be of another body.
fn same_subject(input: &Input, chosen: &Chosen) -> anyhow::Result<()> {
    let Input::Recording(recording) = input else { return Ok(()) };
    let Ok(own) = Config::parse(&recording.header().config_toml, "the recording's configuration") else {
        return Ok(());
    };
    let [recorded, configured] = [&own.subject.id, &chosen.config.subject.id];
    if recorded != configured && !recording.header().subjects(recorded).contains(configured) {
        bail!(
            "the recording is of {recorded}, and the configuration is {configured}'s; give a configuration of {recorded} \
             with --config, or omit it to use the recording's own"
        );
    }
    Ok(())
}
