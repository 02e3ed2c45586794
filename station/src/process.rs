//! What all programs of a station do alike: log, signals, permissions of new files, errors in one line.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

/// Restricts new files to owner and group: recordings, results and logs contain personal motion data.
pub fn restrict_new_files() {
    rustix::process::umask(rustix::fs::Mode::from_raw_mode(0o027));
}

/// A flag that SIGTERM and SIGINT set.
///
/// # Errors
/// The system refuses a handler.
pub fn stop_on_signals() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

/// The error and its causes in one sentence, outermost first; a cause that the text already contains is omitted.
pub fn single_line(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Logs to standard error: under systemd with the journal's own priorities in mind, without colours and times.
pub fn log_to_stderr(default: &str) {
    let requested = std::env::var("RUST_LOG").ok().filter(|text| !text.is_empty());
    let requested: Option<Targets> = requested.and_then(|text| text.parse().ok());
    let filter = requested.unwrap_or_else(|| default.parse().expect("a level"));
    let builder = tracing_subscriber::fmt().with_max_level(LevelFilter::TRACE).with_writer(std::io::stderr);
    let builder = builder.with_target(false);
    if std::env::var_os("JOURNAL_STREAM").is_some() {
        builder.without_time().with_ansi(false).finish().with(filter).init();
    } else {
        let terminal = std::io::IsTerminal::is_terminal(&std::io::stderr());
        builder.with_ansi(terminal).finish().with(filter).init();
    }
}
