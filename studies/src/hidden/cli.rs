//! The bench's commands.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Subcommand};
use serde::{Deserialize, Serialize};

use super::judge::Judged;
use super::long;
use super::make::{self, Order};
use super::score::{self, Asking};
use super::summary;
use super::truth::Truth;
use crate::table::Table;

/// What to do with hidden effects.
#[derive(Debug, Subcommand)]
pub enum Task {
    /// Write recordings with something hidden in them, and the truth in a file of its own
    #[command(after_help = "Example: equipoise-study hidden make --out sessions --sessions 40 --seed 1")]
    Make(MakeChoices),
    /// Have a program reconcile sessions, and judge what it says by the truth
    #[command(
        after_help = "Example: equipoise-study hidden score --dir sessions --program target/release/equipoise"
    )]
    Score(ScoreChoices),
    /// Make sessions, have each judged, and delete its recording
    #[command(
        after_help = "Example: equipoise-study hidden bench --sessions 200 --program target/release/equipoise"
    )]
    Bench(BenchChoices),
    /// Make long recordings, have each reconciled, and print seconds and memory at its highest
    #[command(
        after_help = "Example: equipoise-study hidden long --hours 0.1667 --hours 20\nTwenty hours take about 4 GB of disk \
                      for as long as they are looked at."
    )]
    Long(LongChoices),
    /// The smallest size of each effect that was named, from what `score` or `bench` wrote with --json
    #[command(after_help = "Example: equipoise-study hidden detectable judged.json")]
    Detectable {
        /// Files of `--json`; several are taken together
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
}

/// How to judge.
#[derive(Debug, Args)]
pub struct AskChoices {
    /// The program that is asked
    #[arg(long, value_name = "FILE", default_value = "target/release/equipoise")]
    program: PathBuf,
    /// Do not tell it the spans
    #[arg(long)]
    find_spans: bool,
    /// Keep what was judged of each session
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl AskChoices {
    fn asking(&self) -> Asking {
        Asking { program: self.program.clone(), finds_spans: self.find_spans }
    }
}

/// What to judge.
#[derive(Debug, Args)]
pub struct ScoreChoices {
    /// Folder of the recordings
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,
    #[command(flatten)]
    ask: AskChoices,
}

/// What to make and judge.
#[derive(Debug, Args)]
pub struct BenchChoices {
    /// Folder for truth and passing recordings; a temporary one if not given
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Judge the gap by a clean twin of each session: twice the time
    #[arg(long)]
    twins: bool,
    #[command(flatten)]
    draw: DrawChoices,
    #[command(flatten)]
    ask: AskChoices,
}

/// What to make.
#[derive(Debug, Args)]
pub struct MakeChoices {
    /// Folder for the recordings; the truth goes into its folder `truth`
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    draw: DrawChoices,
    /// Also write each session with nothing hidden in it, into the folder `twins`
    #[arg(long)]
    twins: bool,
}

/// How long.
#[derive(Debug, Args)]
pub struct LongChoices {
    /// Length of a recording, hours; several are made one after the other
    #[arg(long, required = true, value_name = "HOURS", value_parser = hours)]
    hours: Vec<f64>,
    /// The program that is asked
    #[arg(long, value_name = "FILE", default_value = "target/release/equipoise")]
    program: PathBuf,
    /// Folder for the passing recordings; a temporary one if not given
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Identification, clean work and some work in question take five minutes.
fn hours(text: &str) -> Result<f64, String> {
    let hours = text.parse().unwrap_or(f64::NAN);
    if (0.1..=48.0).contains(&hours) { Ok(hours) } else { Err("give hours from 0.1 to 48".to_owned()) }
}

/// Which sessions.
#[derive(Debug, Args)]
pub struct DrawChoices {
    /// How many sessions
    #[arg(long, default_value_t = 40, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    sessions: u16,
    /// Everything random follows from it
    #[arg(long, default_value_t = 1, value_name = "SEED")]
    seed: u64,
    /// Only kinds whose name begins so: `clean`, `pair`, `outside`, `plate_yaw`, …
    #[arg(long, value_name = "KIND")]
    only: Option<String>,
    /// Short sessions, for a first look
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

/// Does it.
pub fn run(task: &Task) -> ExitCode {
    let done = match task {
        Task::Make(choices) => {
            make::make(&choices.draw.order(choices.out.clone(), choices.twins), tell).map(|_| ())
        }
        Task::Score(choices) => score::score(&choices.dir, &choices.ask.asking(), tell_judged)
            .and_then(|judged| show(&judged, choices.ask.json.as_deref())),
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

fn bench(choices: &BenchChoices) -> Result<(), String> {
    let passing = std::env::temp_dir().join(format!("equipoise-bench-{}", std::process::id()));
    let out = choices.out.clone().unwrap_or_else(|| passing.clone());
    let order = choices.draw.order(out, choices.twins);
    let judged = score::bench(&order, &choices.ask.asking(), tell_judged);
    if choices.out.is_none() {
        // Only truth files remain in it; the results contain everything required of them.
        let _ = std::fs::remove_dir_all(&passing);
    }
    show(&judged?, choices.ask.json.as_deref())
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
    let mut judged: Vec<Judged> = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(file)
            .map_err(|error| format!("cannot read {}: {error}", file.display()))?;
        let kept: Kept =
            serde_json::from_str(&text).map_err(|error| format!("{}: {error}", file.display()))?;
        judged.extend(kept.sessions);
    }
    println!("{}", summary::detectable(&judged));
    Ok(())
}

/// What `--json` keeps.
#[derive(Debug, Serialize, Deserialize)]
struct Kept {
    sessions: Vec<Judged>,
    #[serde(default)]
    tables: serde_json::Value,
}

fn show(judged: &[Judged], json: Option<&Path>) -> Result<(), String> {
    let tables = summary::tables(judged);
    for table in &tables {
        println!("{table}");
    }
    let Some(path) = json else { return Ok(()) };
    let tables = tables.iter().map(Table::json).collect();
    let kept = Kept { sessions: judged.to_vec(), tables };
    let text = serde_json::to_string_pretty(&kept).map_err(|error| error.to_string())?;
    std::fs::write(path, text + "\n").map_err(|error| format!("cannot write {}: {error}", path.display()))
}

/// Says how a session went, so that a long run can be followed.
fn tell_judged(judged: &Judged) {
    let hidden = if judged.hidden.is_empty() { judged.kind.clone() } else { judged.hidden.join(" + ") };
    let said = match &judged.failure {
        Some(failure) => failure.clone(),
        None => format!("{} {}", judged.verdict, judged.named.join(" + ")),
    };
    eprintln!("{}: {hidden} {:?} -> {said} ({:.1} s)", judged.session, judged.sizes, judged.seconds);
}

/// Says that a session was made, and nothing of what is in it.
fn tell(truth: &Truth) {
    println!("{}: {:.0} s", truth.session, truth.length_s);
}
