//! The bench's commands.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Subcommand};

use super::make::{self, Order};
use super::truth::Truth;

/// What to do with hidden effects.
#[derive(Debug, Subcommand)]
pub enum Task {
    /// Write recordings with something hidden in them, and the truth beside
    #[command(after_help = "Example: equipoise-study hidden make --out sessions --sessions 40 --seed 1")]
    Make(MakeChoices),
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
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => {
            eprintln!("equipoise-study: {sentence}");
            ExitCode::FAILURE
        }
    }
}

/// Says that a session was made, and nothing of what is in it.
fn tell(truth: &Truth) {
    println!("{}: {:.0} s", truth.session, truth.length_s);
}
