//! `equipoise report`: a session as a page for people.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_config::Config;
use equipoise_discrepancy::report::page;
use equipoise_discrepancy::session_report::{Facts, Source, document, pdf};
use equipoise_files::atomic_file::write_atomically;
use equipoise_recording::record::authenticity::{Authenticity, read_public_key};
use equipoise_recording::record::signature::public_key_of;
use equipoise_recording::replay::input::Input;
use minisign::PublicKey;

use super::Outcome;
use crate::progress_bar::Bar;

/// Report a session as a page: identification, exposure, lifts, dose, low back, latency, data quality
///
/// One self-contained HTML file without scripts. Recorded states are reported as they are; for samples alone and for
/// captures, states are computed by a replay, and the page says so. Withheld values are reported as a share of time
/// with the reason, and are not plotted. The same file gives the same page.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise report shift.mcap                        writes shift.html\n  equipoise report \
                        shift.mcap --pdf shift.pdf        and prints it, where Chromium is installed\n  equipoise report \
                        take.mcap --config station.toml   computes the states again with it\n\nExit \
                        code 3: part of the recording was damaged or is missing; the page's last section says what. Or the recording \
                        was altered, signed by another key, unsigned with --public-key, or the one before it is missing."
)]
pub(super) struct Arguments {
    /// Recording or capture
    file: PathBuf,
    /// Page to write; by default next to the recording, with its name
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Print it, too
    #[arg(long, value_name = "FILE.pdf")]
    pdf: Option<PathBuf>,
    /// Configuration to compute the states with, in place of those recorded
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Public key of minisign to verify the recording's signature with, which it must have; by default SIGN_KEY.pub of
    /// the configuration
    #[arg(long, value_name = "FILE")]
    public_key: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let file = &arguments.file;
    let out = arguments.out.clone().unwrap_or_else(|| file.with_extension("html"));
    for result in [Some(&out), arguments.pdf.as_ref()].into_iter().flatten() {
        if is_same_file(file, result) {
            bail!("{} is the recording itself; choose another name", result.display());
        }
    }
    let input = Input::open(file)?;
    let chosen = input.configuration(arguments.config.as_deref());
    let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
    let authenticity = match &input {
        Input::Recording(recording) => {
            let public_key = public_key(arguments, chosen.as_ref().ok().map(|chosen| &chosen.config))?;
            Some(Authenticity::of(file, recording, public_key.as_ref(), arguments.public_key.is_some())?)
        }
        _ => None,
    };
    // Printed first, because a damaged recording may give no page.
    if let Some(authenticity) = &authenticity {
        println!("{}: {authenticity}", file.display());
    }
    let chosen = chosen?;
    let (bar, as_recorded) = (Bar::new(false), arguments.config.is_none());
    let mut facts =
        bar.follow("reading the recording", &input, || Facts::gather(&name, &input, chosen, as_recorded))?;
    bar.clear();
    facts.authenticity = authenticity.as_ref().map(ToString::to_string);
    let html = page(&document(&facts));
    write_atomically(&out, html.as_bytes()).with_context(|| format!("cannot write {}", out.display()))?;
    let source = match facts.source {
        Source::Recorded => "recorded",
        Source::Replayed => "computed by a replay",
    };
    println!("{}: {} states, {source}", out.display(), facts.cycles);
    if let Some(path) = &arguments.pdf {
        pdf::print(&html, path)?;
        println!("{}: printed", path.display());
    }
    for rejected in &facts.rejected {
        eprintln!("rejected: {rejected}");
    }
    let is_valid = authenticity.is_none_or(|authenticity| authenticity.is_valid());
    Ok(if facts.is_complete() && is_valid { Outcome::Done } else { Outcome::PartRejected })
}

/// The key that is named, or the one next to the secret key of a configuration that is named.
fn public_key(arguments: &Arguments, config: Option<&Config>) -> anyhow::Result<Option<PublicKey>> {
    let next_to_secret = || {
        let base = arguments.config.as_ref()?.parent().unwrap_or(Path::new(""));
        let path = public_key_of(&base.join(config?.recording.as_ref()?.sign_key.as_ref()?));
        path.exists().then_some(path)
    };
    arguments.public_key.clone().or_else(next_to_secret).map(|path| read_public_key(&path)).transpose()
}

fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
