//! `equipoise subject`: the stored profiles, and which one a running daemon uses.

use anyhow::{Context, bail};
use clap::Subcommand;
use equipoise_core::message::command::CommandKind;

use super::{Outcome, StationArgument, client};
use crate::profile::{self, Profile};

/// List, load, save or delete workers' profiles
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  equipoise subject list\n  equipoise subject load anon-1")]
pub(super) struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Show the stored profiles
    List,
    /// Put a stored profile in place of what a running daemon knows
    Load {
        /// Pseudonymous id
        id: String,
        #[command(flatten)]
        station: StationArgument,
    },
    /// Save what a running daemon knows, now
    Save {
        #[command(flatten)]
        station: StationArgument,
    },
    /// Delete a stored profile for good
    Delete {
        /// Pseudonymous id
        id: String,
    },
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.action {
        Action::List => list(),
        Action::Load { id, station } => {
            println!("{}", client::ask(&station.station, CommandKind::SubjectLoad, id)?);
            Ok(Outcome::Done)
        }
        Action::Save { station } => {
            println!("{}", client::ask(&station.station, CommandKind::SubjectSave, "")?);
            Ok(Outcome::Done)
        }
        Action::Delete { id } => delete(id),
    }
}

fn list() -> anyhow::Result<Outcome> {
    let directory = profile::folder();
    let mut files: Vec<_> = match std::fs::read_dir(&directory) {
        Ok(entries) => entries.filter_map(Result::ok).map(|entry| entry.path()).collect(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
        Err(error) => return Err(error).with_context(|| format!("cannot read {}", directory.display())),
    };
    files.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    files.sort();
    let mut refused = false;
    for path in &files {
        match Profile::read(path) {
            Ok(Some(profile)) => println!(
                "{:<32} {:>3} poses  {:>6.1} kg  {:>2} parameters  {}",
                profile.subject,
                profile.poses_used,
                profile.mass_kg,
                profile.parameters,
                if profile.identified { "identified" } else { "not finished" }
            ),
            Ok(None) => {}
            Err(error) => {
                refused = true;
                eprintln!("{error}");
            }
        }
    }
    if files.is_empty() {
        println!("no profiles in {}", directory.display());
    }
    Ok(if refused { Outcome::PartRejected } else { Outcome::Done })
}

fn delete(id: &str) -> anyhow::Result<Outcome> {
    if !profile::is_plain(id) {
        bail!("a subject's id is made of letters, digits, '-' and '_'");
    }
    let path = profile::path_of(id);
    std::fs::remove_file(&path).with_context(|| format!("cannot delete {}", path.display()))?;
    println!("{} is deleted", path.display());
    Ok(Outcome::Done)
}
