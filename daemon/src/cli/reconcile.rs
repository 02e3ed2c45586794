//! `equipoise reconcile`: where model and measurement disagree, what is missing, and the gap with it and without.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use equipoise_discrepancy::spans::{Given, Span};
use indicatif::{ProgressBar, ProgressStyle};

use super::Outcome;
use crate::reconcile::{Progress, Reconcile};
use crate::replay::input::Input;

/// Find where model and measured data disagree, name the missing effect, add it to the model
///
/// Goes through a recording (.mcap) or a capture (.csv, .pcap, .pcapng, with --config): learns the worker from the
/// identification poses, compares what the model predicts with what the plate measured, and asks which effect of the
/// catalogue is missing: a load in a hand, a plate that was moved, a suit that is late, and so on. Spans are found if
/// they are not given, and it says which were taken.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  equipoise reconcile shift.mcap --out shift-reconciled\n  equipoise reconcile shift.mcap \
                  --identify 0:95 --reference 95:240 --work 240:900 --json\n  equipoise reconcile capture.csv --config \
                  examples/human-motion.toml --identify 0:30\n  equipoise replay shift.mcap --model \
                  shift-reconciled/model.toml\n\nExit code 3: part of the data was rejected or is missing; the rest was \
                  used, and the summary says what."
)]
pub(super) struct Arguments {
    /// Recordings or captures; several are handled one after the other
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Configuration to use in place of the recording's own
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Model file whose effects are known already
    #[arg(long, value_name = "MODEL")]
    model: Option<PathBuf>,
    /// Identification poses: begin and end, seconds since the recording's begin
    #[arg(long, value_name = "A:B")]
    identify: Option<String>,
    /// Work known to be clean
    #[arg(long, value_name = "A:B")]
    reference: Option<String>,
    /// Work in question
    #[arg(long, value_name = "A:B")]
    work: Option<String>,
    /// Write model.toml, report.html and report.md here; of several files, each into a folder of its name
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the finding as JSON; of several files, one line each
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let given = Given {
        identify: span("--identify", arguments.identify.as_deref())?,
        reference: span("--reference", arguments.reference.as_deref())?,
        work: span("--work", arguments.work.as_deref())?,
    };
    let mut outcome = Outcome::Done;
    for file in &arguments.files {
        if one(arguments, file, given)? == Outcome::PartRejected {
            outcome = Outcome::PartRejected;
        }
    }
    Ok(outcome)
}

fn span(option: &str, text: Option<&str>) -> anyhow::Result<Option<Span>> {
    text.map(|text| text.parse().map_err(|why: String| anyhow::anyhow!("{option}: {why}"))).transpose()
}

fn one(arguments: &Arguments, file: &Path, given: Given) -> anyhow::Result<Outcome> {
    let input = Input::open(file)?;
    let chosen = input.configuration(arguments.config.as_deref())?;
    let bar = Bar::new(arguments.json);
    let reconcile = Reconcile { input: &input, config: &chosen.config, given };
    let compared = reconcile
        .compare(&mut |progress| bar.show(progress))
        .with_context(|| file.display().to_string())?;
    bar.clear();
    println!("{}", compared.found.told);
    let session = &compared.session;
    for (name, still) in [("still", true), ("moving", false)] {
        let (mut sum, mut count) = ([0.0; 2], 0.0);
        for block in session.blocks.iter().filter(|block| block.still == still) {
            count += 1.0;
            for axis in 0..2 {
                let seen = &block.observation;
                let left = seen.cop_measured_m[axis] - seen.cop_predicted_m[axis];
                sum[axis] += left * left;
            }
        }
        println!("{name}: {count} blocks, {:?} mm", sum.map(|sum: f64| 1e3 * (sum / count).sqrt()));
    }
    Ok(if compared.left_out.rejected.is_empty() { Outcome::Done } else { Outcome::PartRejected })
}

/// Tells people at a terminal how far it is.
struct Bar(Option<ProgressBar>);

impl Bar {
    fn new(json: bool) -> Bar {
        let wanted = !json && std::io::IsTerminal::is_terminal(&std::io::stderr());
        Bar(wanted.then(|| {
            let style = ProgressStyle::with_template("{msg:<32} {wide_bar} {percent:>3} % {eta}");
            let bar = ProgressBar::new(1000).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        }))
    }

    fn show(&self, progress: Progress) {
        if let Some(bar) = &self.0 {
            let at = (1000.0 * progress.share.clamp(0.0, 1.0)) as u64;
            if bar.message() != progress.doing {
                bar.set_message(progress.doing);
                bar.reset_eta();
            }
            bar.set_position(at);
        }
    }

    fn clear(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}
