//! `equipoise report`: a session as a page for people.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_config::Config;
use equipoise_discrepancy::report::page;
use equipoise_discrepancy::session_report::{Facts, Source, document, pdf};
use equipoise_files::atomic_file::write_atomically;
use equipoise_recording::record::authenticity::{Authenticity, read_public_key};
use equipoise_recording::record::signature::public_key_of;
use equipoise_recording::replay::input::{Chosen, Input};
use minisign::PublicKey;

use super::Outcome;
use crate::progress_bar::Bar;

/// Report a session as a page: identification, exposure, lifts, dose, low back, latency, data quality
///
/// One self-contained HTML file without scripts. Recorded states are reported as they are; for samples alone and for
/// captures, states are computed by a replay, and the page says so. Withheld values are reported as a share of time
/// with the reason, and are not plotted. Several recordings give one page that compares sessions and workers side by
/// side and says which cannot be compared. The same files give the same page.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise report shift.mcap                        writes shift.html\n  equipoise report \
                        shift.mcap --pdf shift.pdf        and prints it, where Chromium is installed\n  equipoise report \
                        take.mcap --config station.toml   computes the states again with it\n  equipoise report monday.mcap \
                        friday.mcap           compares them, in comparison.html\n\nExit \
                        code 3: part of the recording was damaged or is missing; the page's last section says what. Or the recording \
                        was altered, signed by another key, unsigned with --public-key, or the one before it is missing."
)]
pub(super) struct Arguments {
    /// Recordings or captures, at most eight
    #[arg(value_name = "FILE", required = true, num_args = 1..=8)]
    files: Vec<PathBuf>,
    /// Page to write; by default next to the recording, with its name; comparison.html next to the first of several
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Print it, too
    #[arg(long, value_name = "FILE.pdf")]
    pdf: Option<PathBuf>,
    /// Configuration to compute the states with, in place of those recorded; several recordings keep their [subject]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Public key of minisign to verify the recording's signature with, which it must have; by default SIGN_KEY.pub of
    /// the configuration
    #[arg(long, value_name = "FILE")]
    public_key: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let files = &arguments.files;
    let out = arguments.out.clone().unwrap_or_else(|| match &files[..] {
        [file] => file.with_extension("html"),
        files => files[0].with_file_name("comparison.html"),
    });
    for (index, file) in files.iter().enumerate() {
        if [Some(&out), arguments.pdf.as_ref()].into_iter().flatten().any(|result| is_same_file(file, result))
        {
            bail!("{} is a recording to report; choose another name for the result", file.display());
        }
        if files[..index].iter().any(|other| is_same_file(file, other)) {
            bail!("{} is given twice; name each recording once", file.display());
        }
    }
    let sessions = files.iter().map(|file| read(file, arguments)).collect::<anyhow::Result<Vec<_>>>()?;
    let (sessions, valid): (Vec<Facts>, Vec<bool>) = sessions.into_iter().unzip();
    let html = page(&document(&sessions));
    write_atomically(&out, html.as_bytes()).with_context(|| format!("cannot write {}", out.display()))?;
    for facts in &sessions {
        let source = match facts.source {
            Source::Recorded => "recorded",
            Source::Replayed => "computed by a replay",
        };
        let of = if sessions.len() > 1 { format!(", {}", facts.name) } else { String::new() };
        println!("{}{of}: {} states, {source}", out.display(), facts.cycles);
    }
    if let Some(path) = &arguments.pdf {
        pdf::print(&html, path)?;
        println!("{}: printed", path.display());
    }
    for facts in &sessions {
        let of = if sessions.len() > 1 { format!("{}: ", facts.name) } else { String::new() };
        for rejected in &facts.rejected {
            eprintln!("rejected: {of}{rejected}");
        }
    }
    let is_valid = sessions.iter().all(Facts::is_complete) && valid.into_iter().all(|is_valid| is_valid);
    Ok(if is_valid { Outcome::Done } else { Outcome::PartRejected })
}

/// Reads a session, and whether the recording is authentic.
fn read(file: &Path, arguments: &Arguments) -> anyhow::Result<(Facts, bool)> {
    let input = Input::open(file)?;
    let chosen = configuration(&input, arguments);
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
    Ok((facts, authenticity.is_none_or(|authenticity| authenticity.is_valid())))
}

/// The configuration of a session. One for several recordings does not describe their subjects.
fn configuration(input: &Input, arguments: &Arguments) -> anyhow::Result<Chosen> {
    let mut chosen = input.configuration(arguments.config.as_deref())?;
    let has_subject = arguments.files.len() > 1 && arguments.config.is_some();
    if has_subject && let Input::Recording(_) = input {
        chosen.config.subject = input.configuration(None)?.config.subject;
        chosen.origin += ", with the recording's own [subject]";
    }
    Ok(chosen)
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
