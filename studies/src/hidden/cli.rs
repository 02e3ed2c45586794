//! Command line of the blind benchmark.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Subcommand};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::evaluation::Evaluation;
use super::long;
use super::make::{self, Order};
use super::scenario::{Experiment, Performed};
use super::score::{self, Asking};
use super::summary;
use super::truth::Truth;
use crate::table::Table;

/// Commands of the blind benchmark.
#[derive(Debug, Subcommand)]
pub enum Task {
    /// Generate recordings with hidden effects, and a truth file of each
    #[command(after_help = "Example: equipoise-study hidden make --out sessions --sessions 40 --seed 1")]
    Make(MakeChoices),
    /// Run reconcile on generated sessions and compare its findings with the truth
    #[command(
        after_help = "Example: equipoise-study hidden score --dir sessions --program target/release/equipoise"
    )]
    Score(ScoreChoices),
    /// Generate sessions, evaluate each as `score` does, and delete its recording
    #[command(
        after_help = "Example: equipoise-study hidden bench --sessions 200 --program target/release/equipoise"
    )]
    Bench(BenchChoices),
    /// Generate long recordings, reconcile each, and print time and peak memory
    #[command(
        after_help = "Example: equipoise-study hidden long --hours 0.1667 --hours 20\nTwenty hours need about 4 GB of disk \
                      during the run."
    )]
    Long(LongChoices),
    /// Print the minimum detectable size of each effect, from results of `score` or `bench` with --json
    #[command(after_help = "Example: equipoise-study hidden detectable results.json")]
    Detectable {
        /// Files written with `--json`; several are combined
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
}

/// Options of the evaluation.
#[derive(Debug, Args)]
pub struct AskChoices {
    /// Program that runs `reconcile`
    #[arg(long, value_name = "FILE", default_value = "target/release/equipoise")]
    program: PathBuf,
    /// Do not pass the spans to the program; it determines them itself
    #[arg(long)]
    find_spans: bool,
    /// Experiments that the simulated person does at the program's request (`bench` only)
    #[arg(long, default_value_t = 0, value_name = "N")]
    experiments: usize,
    /// Write the result of each session and the tables as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl AskChoices {
    fn asking(&self) -> Asking {
        Asking { program: self.program.clone(), finds_spans: self.find_spans, experiments: self.experiments }
    }
}

/// Options of `score`.
#[derive(Debug, Args)]
pub struct ScoreChoices {
    /// Folder of the sessions
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,
    #[command(flatten)]
    ask: AskChoices,
}

/// Options of `bench`.
#[derive(Debug, Args)]
pub struct BenchChoices {
    /// Folder for truth files and temporary recordings; default: a temporary folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Take the oracle's gap from a clean twin of each session; doubles the run time
    #[arg(long)]
    twins: bool,
    #[command(flatten)]
    draw: DrawChoices,
    #[command(flatten)]
    ask: AskChoices,
}

/// Options of `make`.
#[derive(Debug, Args)]
pub struct MakeChoices {
    /// Folder for the recordings; truth files go into its subfolder `truth`
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    draw: DrawChoices,
    /// Also generate each session without its hidden effect, in the subfolder `twins`
    #[arg(long)]
    twins: bool,
    /// Continue each session by the experiment that this finding of `reconcile --json` asks for; repeat it for several
    #[arg(long, value_name = "FINDING")]
    ask: Vec<PathBuf>,
}

/// Options of `long`.
#[derive(Debug, Args)]
pub struct LongChoices {
    /// Length of a recording, hours; repeat it for several recordings
    #[arg(long, required = true, value_name = "HOURS", value_parser = hours)]
    hours: Vec<f64>,
    /// Program that runs `reconcile`
    #[arg(long, value_name = "FILE", default_value = "target/release/equipoise")]
    program: PathBuf,
    /// Folder for the temporary recordings; default: a temporary folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Parses a length; identification, clean work and work in question need five minutes at least.
fn hours(text: &str) -> Result<f64, String> {
    let hours = text.parse().unwrap_or(f64::NAN);
    if (0.1..=48.0).contains(&hours) { Ok(hours) } else { Err("give hours from 0.1 to 48".to_owned()) }
}

/// Selection of the sessions.
#[derive(Debug, Args)]
pub struct DrawChoices {
    /// Number of sessions
    #[arg(long, default_value_t = 40, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    sessions: u16,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 1, value_name = "SEED")]
    seed: u64,
    /// Only kinds whose name starts with this: `clean`, `pair`, `outside`, `plate_yaw`, …
    #[arg(long, value_name = "KIND")]
    only: Option<String>,
    /// Short sessions of about 90 s
    #[arg(long)]
    fast: bool,
}

impl DrawChoices {
    fn order(&self, out: PathBuf, twins: bool) -> Order {
        Order {
            out,
            sessions: usize::from(self.sessions),
            seed: self.seed,
            only: self.only.clone(),
            fast: self.fast,
            twins,
        }
    }
}

/// Runs a command.
pub fn run(task: &Task) -> ExitCode {
    let done = match task {
        Task::Make(choices) => make_sessions(choices),
        Task::Score(choices) => score::score(&choices.dir, &choices.ask.asking(), print_evaluation)
            .and_then(|evaluated| show(&evaluated, choices.ask.json.as_deref())),
        Task::Bench(choices) => bench(choices),
        Task::Detectable { files } => detectable(files),
        Task::Long(choices) => long_recordings(choices),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => {
            eprintln!("equipoise-study: {sentence}");
            ExitCode::FAILURE
        }
    }
}

fn make_sessions(choices: &MakeChoices) -> Result<(), String> {
    let experiments: Result<Vec<Experiment>, String> = choices.ask.iter().map(|path| asked(path)).collect();
    let order = choices.draw.order(choices.out.clone(), choices.twins);
    make::make(&order, &experiments?, print_made).map(|_| ())
}

/// The experiment of a finding in a file.
fn asked(path: &Path) -> Result<Experiment, String> {
    let finding: serde_json::Value = read_json(path)?;
    let ask = Performed::asked(&finding["ask"]);
    ask.map(|ask| ask.experiment)
        .ok_or_else(|| format!("{}: no experiment is asked for in its field `ask`", path.display()))
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, String> {
    let text =
        std::fs::read_to_string(path).map_err(|error| format!("cannot read {}: {error}", path.display()))?;
    serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))
}

fn bench(choices: &BenchChoices) -> Result<(), String> {
    let passing = std::env::temp_dir().join(format!("equipoise-bench-{}", std::process::id()));
    let out = choices.out.clone().unwrap_or_else(|| passing.clone());
    let order = choices.draw.order(out, choices.twins);
    let evaluated = score::bench(&order, &choices.ask.asking(), print_evaluation);
    if choices.out.is_none() {
        // Only truth files remain in it; the results contain everything required of them.
        let _ = std::fs::remove_dir_all(&passing);
    }
    show(&evaluated?, choices.ask.json.as_deref())
}

fn long_recordings(choices: &LongChoices) -> Result<(), String> {
    let passing = std::env::temp_dir().join(format!("equipoise-long-{}", std::process::id()));
    let table = long::table(&choices.program, choices.out.as_ref().unwrap_or(&passing), &choices.hours);
    if choices.out.is_none() {
        // It is empty.
        let _ = std::fs::remove_dir_all(&passing);
    }
    println!("{}", table?);
    Ok(())
}

fn detectable(files: &[PathBuf]) -> Result<(), String> {
    let mut evaluated: Vec<Evaluation> = Vec::new();
    for file in files {
        let sessions_file: SessionsFile = read_json(file)?;
        evaluated.extend(sessions_file.sessions);
    }
    println!("{}", summary::detectable(&evaluated));
    Ok(())
}

/// Content of a file of `--json`.
#[derive(Debug, Serialize, Deserialize)]
struct SessionsFile {
    sessions: Vec<Evaluation>,
    #[serde(default)]
    tables: serde_json::Value,
}

fn show(evaluated: &[Evaluation], json: Option<&Path>) -> Result<(), String> {
    let tables = summary::tables(evaluated);
    for table in &tables {
        println!("{table}");
    }
    let Some(path) = json else { return Ok(()) };
    let tables = tables.iter().map(Table::json).collect();
    let sessions_file = SessionsFile { sessions: evaluated.to_vec(), tables };
    let text = serde_json::to_string_pretty(&sessions_file).map_err(|error| error.to_string())?;
    std::fs::write(path, text + "\n").map_err(|error| format!("cannot write {}: {error}", path.display()))
}

/// Prints the result of a session as progress.
fn print_evaluation(evaluated: &Evaluation) {
    let hidden =
        if evaluated.hidden.is_empty() { evaluated.kind.clone() } else { evaluated.hidden.join(" + ") };
    let result = match &evaluated.failure {
        Some(failure) => failure.clone(),
        None => format!("{} {}", evaluated.verdict, evaluated.named.join(" + ")),
    };
    eprintln!(
        "{}: {hidden} {:?} -> {result} ({:.1} s)",
        evaluated.session, evaluated.sizes, evaluated.seconds
    );
}

/// Prints that a session was generated, without its hidden effect.
fn print_made(truth: &Truth) {
    println!("{}: {:.0} s", truth.session, truth.length_s);
}
