//! `equipoise subject`: the stored profiles, and which one a running daemon uses.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Subcommand;
use equipoise_core::message::command::CommandKind;
use equipoise_daemon::profile::Profile;
use equipoise_station::state_directory::StateDirectory;

use super::{Outcome, StationArgument};
use crate::client;
use crate::deletion::Deletion;
use crate::progress_bar::Bar;
use crate::subject_export::{INDEX, SubjectExport};

/// List, load, save, export or delete workers' profiles, take a lift back
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  equipoise subject list\n  equipoise subject load anon-1\n  equipoise \
                        subject export anon-1 --out anon-1.tar --recordings ~/recordings --with-recordings\n  equipoise \
                        subject delete anon-1 --recordings ~/recordings --with-recordings")]
pub(super) struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Show the stored profiles
    List,
    /// Load a stored profile into a running daemon
    Load {
        /// Pseudonymous id
        id: String,
        #[command(flatten)]
        station: StationArgument,
    },
    /// Save the active subject's profile now
    Save {
        #[command(flatten)]
        station: StationArgument,
    },
    /// Take the last lift of the shift back
    ///
    /// For a wrongly detected lift: it is removed from dose and count, and noted in the list of lifts next to the
    /// profile. Repeat for earlier ones, up to 16.
    UndoLift {
        #[command(flatten)]
        station: StationArgument,
    },
    /// Export all stored data of a subject, as for a request by that person
    ///
    /// Copies what `subject delete` removes: profile, list of lifts, entries of stations, recordings. Flight records name no
    /// subject and may be of another person, as recordings of several subjects are: read index.json before handing the
    /// export over. Prints what is not exported.
    #[command(
        after_help = "Example:\n  equipoise subject export anon-1 --out anon-1.tar --recordings ~/recordings \
                            --with-recordings"
    )]
    Export {
        /// Pseudonymous id
        id: String,
        /// New folder, or archive if the name ends in .tar
        #[arg(long, value_name = "DIR|FILE")]
        out: PathBuf,
        /// List recordings of the subject in this folder and below
        #[arg(long, value_name = "DIR")]
        recordings: Option<PathBuf>,
        /// Copy those recordings too
        #[arg(long, requires = "recordings")]
        with_recordings: bool,
    },
    /// Delete a subject for good
    ///
    /// Deletes the profile, entries in stations' files, and the data of running daemons on this bus; a daemon that has
    /// the subject in use continues with an unknown one. Searches the state directories of those daemons and of the
    /// environment. All flight records next to the profile are deleted, since they name no subject. Prints what is not
    /// deleted.
    Delete {
        /// Pseudonymous id
        id: String,
        /// Look for recordings of the subject in this folder and below
        #[arg(long, value_name = "DIR")]
        recordings: Option<PathBuf>,
        /// Delete those recordings too
        #[arg(long, requires = "recordings")]
        with_recordings: bool,
    },
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.action {
        Action::List => list(),
        Action::Load { id, station } => {
            println!("{}", client::request(&station.station, CommandKind::SubjectLoad, id)?);
            Ok(Outcome::Done)
        }
        Action::Save { station } => {
            println!("{}", client::request(&station.station, CommandKind::SubjectSave, "")?);
            Ok(Outcome::Done)
        }
        Action::UndoLift { station } => {
            println!("{}", client::request(&station.station, CommandKind::UndoLift, "")?);
            Ok(Outcome::Done)
        }
        Action::Export { id, out, recordings, with_recordings } => {
            export(id, out, recordings.as_deref(), *with_recordings)
        }
        Action::Delete { id, recordings, with_recordings } => {
            delete(id, recordings.as_deref(), *with_recordings)
        }
    }
}

fn list() -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::Done;
    for directory in StateDirectory::of_bus()? {
        if let Outcome::PartRejected = list_profiles(&directory)? {
            outcome = Outcome::PartRejected;
        }
    }
    Ok(outcome)
}

fn list_profiles(directory: &StateDirectory) -> anyhow::Result<Outcome> {
    let folder = directory.profiles();
    let files = directory.profile_files().with_context(|| format!("cannot read {}", folder.display()))?;
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
        println!("no profiles in {}", folder.display());
    }
    Ok(if refused { Outcome::PartRejected } else { Outcome::Done })
}

fn check_id(id: &str) -> anyhow::Result<()> {
    if !equipoise_config::is_plain(id) {
        bail!("a subject's id is made of letters, digits, '-' and '_'");
    }
    Ok(())
}

fn no_profile(id: &str, directories: &[StateDirectory]) -> anyhow::Error {
    let searched: Vec<String> =
        directories.iter().map(|found| found.profiles().display().to_string()).collect();
    anyhow::anyhow!(
        "there is no profile {id} in {}; another place is named by STATE_DIRECTORY",
        searched.join(" nor in ")
    )
}

/// Prints files that could not be read, and files that are no recordings.
fn print_not_read(unknown: &[String], skipped: &[PathBuf]) {
    for reason in unknown {
        println!("NOT looked into: {reason}");
    }
    for path in skipped {
        println!("NOT looked into: {} is no .mcap file", path.display());
    }
}

/// Prints which data of a subject no command searches.
fn print_not_searched(recordings: Option<&Path>) {
    match recordings {
        Some(_) => println!("NOT looked for: reports, model files and replays made from recordings; backups"),
        None => println!(
            "NOT looked for: recordings (name their folder with --recordings DIR); reports, model files and replays \
             made from them; backups"
        ),
    }
}

fn export(id: &str, out: &Path, recordings: Option<&Path>, with_recordings: bool) -> anyhow::Result<Outcome> {
    check_id(id)?;
    let mut export = SubjectExport::find(id, StateDirectory::of_environment())?;
    if let Some(folder) = recordings {
        export.search_recordings(id, folder, with_recordings)?;
    }
    if !export.found() {
        return Err(no_profile(id, &export.directories));
    }
    let bar = Bar::new(false);
    let written = export.write(id, out, &mut |fraction| bar.update("copying", fraction));
    bar.clear();
    written?;
    for file in &export.files {
        println!("{} is exported", file.path.display());
    }
    for path in &export.not_copied {
        println!("NOT exported: {} holds data of {id}; --with-recordings copies it too", path.display());
    }
    print_not_read(&export.unknown, &export.skipped);
    for file in export.shared(id) {
        println!("note: {} holds data of other subjects too", file.path.display());
    }
    if export.has_uncertain() {
        println!("note: flight records and leftovers name no subject and may be of another: see {INDEX}");
    }
    print_not_searched(recordings);
    println!("{}: {} files, and {INDEX}", out.display(), export.files.len());
    Ok(if export.unknown.is_empty() { Outcome::Done } else { Outcome::PartRejected })
}

fn delete(id: &str, recordings: Option<&Path>, with_recordings: bool) -> anyhow::Result<Outcome> {
    check_id(id)?;
    let mut deletion = Deletion::default();
    // Daemons first, so that none of them writes deleted files again.
    deletion.request_from_daemons(|station| client::request(station, CommandKind::SubjectDelete, id))?;
    deletion.clear_state(id, StateDirectory::of_environment())?;
    if let Some(folder) = recordings {
        deletion.search_recordings(id, folder, with_recordings)?;
    }
    for answer in &deletion.daemons {
        println!("{answer}");
    }
    for path in &deletion.deleted {
        println!("{} is deleted", path.display());
    }
    for path in &deletion.flights {
        println!("{} is deleted: flight records name no subject, so it may be of {id}", path.display());
    }
    for path in &deletion.changed {
        println!("{} does not name {id} any more", path.display());
    }
    for path in &deletion.recordings {
        println!("NOT deleted: {} holds data of {id}; --with-recordings deletes it too", path.display());
    }
    print_not_read(&deletion.unknown, &deletion.skipped);
    if !deletion.found() {
        return Err(no_profile(id, &deletion.directories));
    }
    if let Some(missing) = deletion.missing(id) {
        bail!("{missing}");
    }
    print_not_searched(recordings);
    Ok(if deletion.unknown.is_empty() { Outcome::Done } else { Outcome::PartRejected })
}
